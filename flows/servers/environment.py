"""Prepares the environment of this process for Prefect and MLflow, before either is imported."""

from __future__ import annotations

import logging
import os

from flows.running.data_folder import prepare_folder, sqlite_address
from flows.running.services import find_services
from flows.running.settings import Settings
from flows.servers.addresses import check_address, check_reachable, is_answering
from flows.servers.guard import Credentials
from flows.servers.secret import credentials_of

API_VARIABLE = "PREFECT_API_URL"
PASSWORD_VARIABLE = "PREFECT_API_AUTH_STRING"
DATABASE_VARIABLE = "PREFECT_SERVER_DATABASE_CONNECTION_URL"
EXTRA_LOGGERS = ("flows", "stages", "juicer")


def quiet_environment(settings: Settings) -> dict[str, str]:
    """Variables that keep both servers from calling home or talking over the progress lines."""
    return {
        "DO_NOT_TRACK": "1",
        "PREFECT_SERVER_ANALYTICS_ENABLED": "false",
        "MLFLOW_DISABLE_TELEMETRY": "true",
        "MLFLOW_ALLOW_PICKLE_DESERIALIZATION": "false",
        "MLFLOW_HTTP_REQUEST_MAX_RETRIES": "2",
        "MLFLOW_HTTP_REQUEST_TIMEOUT": "20",
        "MLFLOW_SUPPRESS_PRINTING_URL_TO_STDOUT": "true",
        "MLFLOW_LOGGING_LEVEL": "WARNING",
        # Eight processes for features that have to do with language models.
        "MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false",
        "GIT_PYTHON_REFRESH": "quiet",
        "PREFECT_CLIENT_MAX_RETRIES": "3",
        "PREFECT_LOGGING_SERVER_LEVEL": "CRITICAL",
        "PREFECT_LOGGING_HANDLERS_CONSOLE_LEVEL": "CRITICAL",
        "PREFECT_LOGGING_HANDLERS_DEBUG_LEVEL": "CRITICAL",
        "PREFECT_LOGGING_EXTRA_LOGGERS": ",".join(EXTRA_LOGGERS),
        "PREFECT_SERVER_EPHEMERAL_STARTUP_TIMEOUT_SECONDS": str(settings.startup_seconds),
    }


def prefect_database(settings: Settings) -> str:
    """Database of Prefect servers that juicer starts: the temporary one of a flow, and that of ``juicer ui``."""
    return sqlite_address("sqlite+aiosqlite", settings.folder / "prefect.db")


def auth_string(credentials: Credentials) -> str:
    """A password in Prefect's form."""
    return f"{credentials.user}:{credentials.password}"


def prepare_environment(settings: Settings) -> bool:
    """Set what the user has not set; returns whether a running Prefect server will be used.

    Raises:
        ConfigError: If the address of a Prefect server is none.
        ServiceUnavailable: If a Prefect server is configured and does not answer, or the data folder cannot be used.
    """
    for name, value in quiet_environment(settings).items():
        os.environ.setdefault(name, value)
    # Log records that no server takes must not turn up between the progress lines.
    logging.raiseExceptions = False
    for name in EXTRA_LOGGERS:
        logging.getLogger(name).setLevel(logging.INFO)
    prepare_folder(settings)
    if os.environ.get(API_VARIABLE) or _use_announced(settings):
        url = os.environ[API_VARIABLE]
        check_address(API_VARIABLE, url)
        check_reachable("Prefect server", url, f"start it, or unset {API_VARIABLE} to run without one")
        return True
    os.environ.setdefault(DATABASE_VARIABLE, prefect_database(settings))
    return False


def _use_announced(settings: Settings) -> bool:
    """Point Prefect to the server of ``juicer ui``, if it runs."""
    services = find_services(settings.folder)
    if services is None or not is_answering(f"{services.prefect_api}/health"):
        return False
    os.environ[API_VARIABLE] = services.prefect_api
    os.environ[PASSWORD_VARIABLE] = auth_string(credentials_of(settings.folder))
    return True
