"""``juicer ui``: Prefect's and MLflow's servers on loopback, found by every flow that starts while they run."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from flows.commands.output import say, say_json
from flows.environment import API_VARIABLE, DATABASE_VARIABLE, prefect_database, quiet_environment
from flows.opening import destination
from flows.services import (
    LOOPBACK,
    Services,
    announced,
    choose_port,
    find_services,
    is_mlflow_healthy,
    is_prefect_healthy,
)
from flows.settings import Settings, read_settings
from juicer.errors import ServiceUnavailable
from stages.tracking.courier import initialise

PREFECT_PORT = 4200
MLFLOW_PORT = 5000
POLL_SECONDS = 0.5
GRACE_SECONDS = 10.0


def serve_pages(prefect_port: int | None, mlflow_port: int | None, as_json: bool) -> None:
    """Serve both until Ctrl-C.

    Raises:
        ServiceUnavailable: If a port is in use, a server does not start, or one ends by itself.
        TrackingError: If the tracking database cannot be used.
    """
    settings = read_settings()
    running = find_services(settings.folder)
    if running and is_prefect_healthy(running):
        raise ServiceUnavailable(f"the pages are already served: Prefect {running.prefect}, MLflow {running.mlflow}")
    services = Services(
        prefect=f"http://{LOOPBACK}:{choose_port(prefect_port, PREFECT_PORT, 'Prefect')}",
        mlflow=f"http://{LOOPBACK}:{choose_port(mlflow_port, MLFLOW_PORT, 'MLflow')}",
    )
    if not as_json:
        say("starting Prefect's and MLflow's servers ...")
    initialise(settings.folder / "tracking", destination(settings))
    logs = settings.folder / "logs-of-servers"
    logs.mkdir(parents=True, exist_ok=True)
    with (
        _server("prefect", _prefect_command(services), _prefect_variables(settings, services), logs) as prefect,
        _server("mlflow", _mlflow_command(settings, services), {}, logs) as mlflow,
    ):
        servers = {"Prefect": prefect, "MLflow": mlflow}
        _await(settings, servers, lambda: is_prefect_healthy(services) and is_mlflow_healthy(services), logs)
        with announced(settings.folder, services), suppress(KeyboardInterrupt):
            _say(services, as_json)
            while not _ended(servers):
                time.sleep(POLL_SECONDS)
            raise ServiceUnavailable(f"{_ended(servers)}'s server ended by itself; its log is in '{logs}'")


def _prefect_command(services: Services) -> list[str]:
    return ["prefect", "server", "start", "--host", LOOPBACK, "--port", _port(services.prefect)]


def _prefect_variables(settings: Settings, services: Services) -> dict[str, str]:
    database = os.environ.get(DATABASE_VARIABLE) or prefect_database(settings)
    return {
        API_VARIABLE: services.prefect_api,
        "PREFECT_SERVER_UI_API_URL": services.prefect_api,
        DATABASE_VARIABLE: database,
        "PREFECT_LOGGING_SERVER_LEVEL": "WARNING",
    }


def _mlflow_command(settings: Settings, services: Services) -> list[str]:
    place = destination(settings)
    command = ["mlflow", "server", "--host", LOOPBACK, "--port", _port(services.mlflow), "--workers", "1"]
    command += ["--backend-store-uri", place.uri]
    if place.artifact_root:
        command += ["--default-artifact-root", place.artifact_root.as_uri()]
    return command


def _port(url: str) -> str:
    return url.rpartition(":")[2]


@contextmanager
def _server(
    name: str, command: Sequence[str], variables: Mapping[str, str], logs: Path
) -> Iterator[subprocess.Popen[bytes]]:
    environment = {**os.environ, **quiet_environment(read_settings()), **variables}
    with (logs / f"{name}.log").open("wb") as log:
        process = subprocess.Popen(
            [sys.executable, "-m", *command],
            env=environment,
            stdout=log,
            stderr=subprocess.STDOUT,
            # Ctrl-C must reach this process only, which then ends both in order.
            start_new_session=True,
        )
        try:
            yield process
        finally:
            _end(process)


def _end(process: subprocess.Popen[bytes]) -> None:
    """End a server with all its workers."""
    for number in (signal.SIGTERM, signal.SIGKILL):
        try:
            os.killpg(process.pid, number)
            process.wait(GRACE_SECONDS)
        except ProcessLookupError:
            return
        except subprocess.TimeoutExpired:
            continue


def _await(
    settings: Settings,
    servers: Mapping[str, subprocess.Popen[bytes]],
    is_healthy: Callable[[], bool],
    logs: Path,
) -> None:
    deadline = time.monotonic() + settings.startup_seconds
    while not is_healthy():
        if name := _ended(servers):
            raise ServiceUnavailable(f"{name}'s server did not start; its log is in '{logs}'")
        if time.monotonic() > deadline:
            raise ServiceUnavailable(
                f"the servers did not answer within {settings.startup_seconds} s; "
                f"set JUICER_STARTUP_SECONDS to wait longer, their logs are in '{logs}'"
            )
        time.sleep(POLL_SECONDS)


def _ended(servers: Mapping[str, subprocess.Popen[bytes]]) -> str | None:
    return next((name for name, process in servers.items() if process.poll() is not None), None)


def _say(services: Services, as_json: bool) -> None:
    if as_json:
        say_json({"prefect": services.prefect, "mlflow": services.mlflow})
        return
    say(f"Prefect  {services.prefect}")
    say(f"MLflow   {services.mlflow}/#/experiments")
    say("flows that start now are shown there; Ctrl-C ends both")
