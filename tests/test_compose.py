"""The Compose file cannot be run by these tests; everything in it that can be checked without Docker is.

Its schema is Compose's own. Every command is parsed by the program it calls, in the version installed here, and
every variable it sets is one that program reads.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
import yaml

from flows.servers.guard import host_name, host_names, loopback_names
from juicer import __version__

ROOT = Path(__file__).parents[1]
COMPOSE = ROOT / "docker-compose.yml"
DOCKERFILE = ROOT / "docker" / "Dockerfile"
OWN_IMAGE = f"juicer:{__version__}"
VARIABLE = re.compile(r"\$\{(?P<name>[A-Z_]+)(?::-(?P<default>[^}]*)|:\?(?P<complaint>[^}]*))?\}")


def read_example() -> dict[str, str]:
    lines = (ROOT / "docker" / "example.env").read_text().splitlines()
    return dict(line.split("=", 1) for line in lines if line and not line.startswith("#"))


def interpolated(value: Any, environment: Mapping[str, str]) -> Any:
    """Value with Compose's variables filled in, as Compose does it."""
    if isinstance(value, dict):
        return {key: interpolated(item, environment) for key, item in value.items()}
    if isinstance(value, list):
        return [interpolated(item, environment) for item in value]
    if isinstance(value, str):
        return VARIABLE.sub(lambda match: environment.get(match["name"], match["default"] or ""), value)
    return value


@pytest.fixture(scope="module")
def services() -> dict[str, dict[str, Any]]:
    content = yaml.safe_load(COMPOSE.read_text())
    return dict(interpolated(content["services"], read_example()))


def commands_of(services: Mapping[str, dict[str, Any]], program: str) -> Iterator[list[str]]:
    """Arguments of every command and health check that calls a program of our own image."""
    for service in services.values():
        if service["image"] != OWN_IMAGE:
            continue
        calls = [service["command"], service.get("healthcheck", {}).get("test", ["CMD"])[1:]]
        for call in calls:
            if call and call[0] == program:
                yield call[1:]


def environment_names(services: Mapping[str, dict[str, Any]], prefix: str) -> set[str]:
    return {name for service in services.values() for name in service.get("environment", {}) if name.startswith(prefix)}


def test_file_follows_the_schema_of_compose():
    call = [sys.executable, "-m", "check_jsonschema", "--builtin-schema", "vendor.compose-spec", str(COMPOSE)]
    done = subprocess.run(call, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_everything_a_team_needs_is_there(services: dict[str, Any]):
    assert {"database", "storage", "prefect", "mlflow", "worker"} <= set(services)


def test_every_variable_has_a_default_or_an_example():
    example = read_example()
    for match in VARIABLE.finditer(COMPOSE.read_text()):
        assert match["default"] is not None or match["name"] in example, match["name"]


def test_no_secret_has_a_default():
    for match in VARIABLE.finditer(COMPOSE.read_text()):
        assert not ("PASSWORD" in match["name"] or "KEY" in match["name"]) or match["default"] is None


def test_images_are_pinned_to_exact_versions(services: dict[str, Any]):
    images = {service["image"] for service in services.values()} | set(
        re.findall(r"^FROM (\S+)", DOCKERFILE.read_text(), re.M)
    )
    for image in images:
        assert re.search(r":v?\d+\.\d+", image), image


def test_own_image_bears_the_version_of_the_package(services: dict[str, Any]):
    from juicer import __version__

    assert f"juicer:{__version__}" == OWN_IMAGE
    assert sum("build" in service for service in services.values()) == 1


def test_ports_are_open_to_this_machine_only(services: dict[str, Any]):
    ports = [port for service in services.values() for port in service.get("ports", [])]
    assert ports
    assert all(port.startswith("127.0.0.1:") for port in ports)


def test_services_volumes_and_mounted_files_exist(services: dict[str, Any]):
    volumes = yaml.safe_load(COMPOSE.read_text())["volumes"]
    for service in services.values():
        assert set(service.get("depends_on", ())) <= set(services)
        for mount in service.get("volumes", []):
            source = mount.split(":")[0]
            assert (ROOT / source).exists() if source.startswith(".") else source in volumes, mount


def test_servers_run_behind_the_guard(services: dict[str, Any]):
    for name in ("prefect", "mlflow"):
        program, command, server, *_ = services[name]["command"]
        assert (program, command, server) == ("juicer", "server", name)
    assert not {"prefect", "mlflow"} & {service["command"][0] for service in services.values() if "command" in service}


def test_servers_are_reached_by_the_names_that_the_worker_uses(services: dict[str, Any]):
    worker = services["worker"]["environment"]
    for name, url in (("prefect", worker["PREFECT_API_URL"]), ("mlflow", worker["JUICER_TRACKING_URI"])):
        names = host_names(services[name]["environment"]["JUICER_ALLOWED_HOSTS"].split(","))
        assert host_name(url) in names
        assert names.isdisjoint(loopback_names(1))


def test_worker_knows_the_passwords_of_both_servers(services: dict[str, Any]):
    worker, prefect, mlflow = (services[name]["environment"] for name in ("worker", "prefect", "mlflow"))
    assert worker["PREFECT_API_AUTH_STRING"] == prefect["PREFECT_SERVER_API_AUTH_STRING"] == "juicer:changeme4"
    for name in ("MLFLOW_TRACKING_USERNAME", "MLFLOW_TRACKING_PASSWORD"):
        assert worker[name] == mlflow[name]


def test_juicer_has_the_commands_it_is_called_with(services: dict[str, Any]):
    import typer

    from flows.command.cli import app

    group = typer.main.get_command(app)
    commands = list(commands_of(services, "juicer"))
    assert commands
    for name, *arguments in commands:
        assert name in group.commands
        group.commands[name].make_context(name, arguments)


def test_python_scripts_are_in_the_image(services: dict[str, Any]):
    copied = " ".join(re.findall(r"^COPY (.+)$", DOCKERFILE.read_text(), re.M)).split()
    scripts = [arguments[0] for arguments in commands_of(services, "python")]
    assert scripts
    assert set(scripts) <= set(copied)


def test_what_the_image_copies_exists_and_is_sent_to_docker():
    allowed = (ROOT / ".dockerignore").read_text()
    for line in re.findall(r"^COPY (.+)$", DOCKERFILE.read_text(), re.M):
        *sources, _ = line.split()
        for source in sources:
            assert (ROOT / source).exists(), source
            assert f"!{source.split('/')[0]}" in allowed, source


def test_prefect_reads_the_variables_that_are_set(services: dict[str, Any]):
    from prefect import settings

    unknown = {name for name in environment_names(services, "PREFECT_") if not hasattr(settings, name)}
    assert unknown == {"PREFECT_DATABASE_PASSWORD"}  # of PostgreSQL's image


def test_mlflow_reads_the_variables_that_are_set(services: dict[str, Any]):
    import mlflow.environment_variables as mlflow_variables
    from mlflow.cli import cli

    known = {parameter.envvar for parameter in cli.commands["server"].params}
    known |= {name for name in dir(mlflow_variables) if name.startswith("MLFLOW_")}
    assert environment_names(services, "MLFLOW_") - {"MLFLOW_DATABASE_PASSWORD"} <= known


def test_juicer_reads_the_variables_that_are_set(services: dict[str, Any]):
    from flows.running.settings import Settings

    assert environment_names(services, "JUICER_") <= {f"JUICER_{name.upper()}" for name in Settings.model_fields}


def test_database_addresses_name_drivers_that_the_image_installs(services: dict[str, Any]):
    addresses = [
        value
        for service in services.values()
        for value in service.get("environment", {}).values()
        if value.startswith("postgresql")
    ]
    assert sorted(address.split(":")[0] for address in addresses) == ["postgresql+asyncpg", "postgresql+psycopg"]
    assert '"psycopg[binary]' in (ROOT / "pyproject.toml").read_text()


@pytest.mark.parametrize(
    "script",
    ["docker/create-databases.sh", ".ci/run", *(f"scripts/{path.name}" for path in (ROOT / "scripts").glob("*.sh"))],
)
def test_shell_scripts_parse_and_may_be_executed(script: str):
    subprocess.run(["bash", "-n", script], cwd=ROOT, check=True)
    assert os.access(ROOT / script, os.X_OK)


def test_buckets_are_created_once(monkeypatch: pytest.MonkeyPatch):
    server = pytest.importorskip("moto.server").ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    try:
        host, port = server.get_host_and_port()
        environment = os.environ | {
            "AWS_ENDPOINT_URL": f"http://{host}:{port}",
            "AWS_ACCESS_KEY_ID": "juicer",
            "AWS_SECRET_ACCESS_KEY": "secret",
            "AWS_DEFAULT_REGION": "us-east-1",
        }
        for _ in range(2):
            call = [sys.executable, "docker/create_buckets.py", "juicer", "mlflow"]
            subprocess.run(call, cwd=ROOT, env=environment, check=True)
        for name, value in environment.items():
            monkeypatch.setenv(name, value)
        import s3fs

        # The servers of all tests of a process share their buckets.
        assert set(s3fs.S3FileSystem(skip_instance_cache=True).ls("")) >= {"juicer", "mlflow"}
    finally:
        server.stop()
