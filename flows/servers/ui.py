"""``juicer ui``: Prefect's and MLflow's servers on loopback, found by every flow that starts while they run."""

from __future__ import annotations

import os
import shlex
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from flows.running.context import destination
from flows.running.data_folder import prepare_folder, write_private, writing
from flows.running.flow_runs import mark_crashed
from flows.running.services import Services, announce, find_services, only_one
from flows.running.settings import Settings, read_settings
from flows.servers.addresses import PORTS, listen
from flows.servers.environment import (
    API_VARIABLE,
    DATABASE_VARIABLE,
    PASSWORD_VARIABLE,
    auth_string,
    prefect_database,
    quiet_environment,
)
from flows.servers.guard import Credentials
from flows.servers.process import POLL_SECONDS, ServerProcess, await_health, title
from flows.servers.program import MLFLOW_PASSWORD, MLFLOW_USER, NAMES_VARIABLE, PREFECT_PASSWORD
from flows.servers.secret import SECRET_FILE, credentials_of
from flows.terminal.output import say, say_json
from juicer.errors import ConfigError, ServiceUnavailable
from stages.tracking.destination import Destination, newest_study, runs_page, without_credentials

ENVIRONMENT_FILE = "servers.env"


def serve_pages(prefect_port: int | None, mlflow_port: int | None, as_json: bool) -> None:
    """Serve both until Ctrl-C.

    Raises:
        ConfigError: If MLflow's records are on a server that has pages of its own.
        ServiceUnavailable: If a port is in use, a server does not start, or one ends by itself.
        TrackingError: If the tracking database cannot be used.
    """
    settings = read_settings()
    place = _local_destination(settings)
    prepare_folder(settings)
    with only_one(settings.folder) as is_free, ExitStack() as stack:
        if not is_free:
            running = find_services(settings.folder)
            where = f": Prefect {running.prefect}, MLflow {running.mlflow}" if running else ""
            raise ServiceUnavailable(f"the pages are already served{where}")
        listeners = [
            stack.enter_context(listen(prefect_port, PORTS["prefect"], "Prefect")),
            stack.enter_context(listen(mlflow_port, PORTS["mlflow"], "MLflow")),
        ]
        credentials = credentials_of(settings.folder)
        if not as_json:
            say("starting Prefect's and MLflow's servers ...")
        os.environ.update(quiet_environment(settings) | {NAMES_VARIABLE: settings.allowed_hosts})
        # The lock that runs hold, too, when they make the database.
        study = newest_study(place.initialise())
        logs = settings.folder / "logs-of-servers"
        with writing(logs):
            logs.mkdir(exist_ok=True)
        variables = (_prefect_variables(settings, credentials), _mlflow_variables(settings, place, credentials))
        servers = []
        for name, health, listener, added in zip(
            ("prefect", "mlflow"), ("/api/health", "/health"), listeners, variables, strict=True
        ):
            server = ServerProcess(name, health, listener, added, logs / f"{name}.log")
            stack.callback(server.stop)
            servers.append(server)
        await_health(servers, settings.startup_seconds)
        services = Services(*(server.url for server in servers))
        mark_crashed(settings.folder, services.prefect_api, auth_string(credentials))
        stack.enter_context(announce(settings.folder, services))
        stack.enter_context(_environment_file(settings.folder, services, credentials))
        with suppress(KeyboardInterrupt):
            _say(settings.folder, services, credentials, runs_page(services.mlflow, study), as_json)
            _watch(servers)


def _watch(servers: list[ServerProcess]) -> None:
    while True:
        for server in servers:
            if server.has_ended:
                raise ServiceUnavailable(f"{title(server.name)}'s server ended by itself: {server.cause()}")
        time.sleep(POLL_SECONDS)


def _local_destination(settings: Settings) -> Destination:
    if not settings.tracks:
        settings = settings.model_copy(update={"tracking_uri": ""})
    if settings.tracking_uri.startswith(("http:", "https:")):
        address = without_credentials(settings.tracking_uri)
        raise ConfigError(
            f"JUICER_TRACKING_URI is the address of a server that has its own pages, {address}; "
            "unset it to serve the records of this machine"
        )
    return destination(settings)


def _prefect_variables(settings: Settings, credentials: Credentials) -> dict[str, str]:
    return {
        PREFECT_PASSWORD: auth_string(credentials),
        # Where the pages are; whoever is forwarded to another port or name finds the API there, too.
        "PREFECT_SERVER_UI_API_URL": "/api",
        # Prefect prepares its pages in a folder of its package otherwise, which need not be ours to write.
        "PREFECT_SERVER_UI_STATIC_DIRECTORY": str(settings.folder / ".prefect-pages"),
        DATABASE_VARIABLE: os.environ.get(DATABASE_VARIABLE) or prefect_database(settings),
        "PREFECT_LOGGING_SERVER_LEVEL": "WARNING",
    }


def _mlflow_variables(settings: Settings, place: Destination, credentials: Credentials) -> dict[str, str]:
    return {
        MLFLOW_USER: credentials.user,
        MLFLOW_PASSWORD: credentials.password,
        "MLFLOW_BACKEND_STORE_URI": place.uri,
        # Whoever has files writes them there; the server takes none, and only shows them.
        "MLFLOW_DEFAULT_ARTIFACT_ROOT": (place.artifact_root or settings.folder / "mlflow-files").as_uri(),
        "MLFLOW_ARTIFACTS_DESTINATION": "",
    }


@contextmanager
def _environment_file(folder: Path, services: Services, credentials: Credentials) -> Iterator[None]:
    """What the commands of Prefect and MLflow need, to be read by a shell, for the length of a block."""
    variables = {
        API_VARIABLE: services.prefect_api,
        PASSWORD_VARIABLE: auth_string(credentials),
        "MLFLOW_TRACKING_URI": services.mlflow,
        MLFLOW_USER: credentials.user,
        MLFLOW_PASSWORD: credentials.password,
    }
    path = folder / ENVIRONMENT_FILE
    write_private(path, "".join(f"export {name}={shlex.quote(value)}\n" for name, value in variables.items()))
    try:
        yield
    finally:
        path.unlink(missing_ok=True)


def _say(folder: Path, services: Services, credentials: Credentials, records: str, as_json: bool) -> None:
    environment = folder / ENVIRONMENT_FILE
    if as_json:
        say_json(
            {
                "prefect": services.prefect,
                "mlflow": services.mlflow,
                "user": credentials.user,
                "password_file": str(folder / SECRET_FILE),
                "environment": str(environment),
            }
        )
        return
    say(f"Prefect  {services.prefect}   password {auth_string(credentials)}")
    say(f"MLflow   {records}   user {credentials.user}, password {credentials.password}")
    say(f"shell    source {shlex.quote(str(environment))}   for the commands `prefect` and `mlflow`")
    say("flows that start now are shown there; Ctrl-C ends both")
