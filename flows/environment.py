"""Prepares the environment of this process for Prefect and MLflow, before either is imported."""

from __future__ import annotations

import logging
import os
from pathlib import Path

from flows.services import check_address, check_reachable, find_services, is_prefect_healthy
from flows.settings import Settings
from juicer.errors import ServiceUnavailable

API_VARIABLE = "PREFECT_API_URL"
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
        "PREFECT_LOGGING_EXTRA_LOGGERS": ",".join(EXTRA_LOGGERS),
        "PREFECT_SERVER_EPHEMERAL_STARTUP_TIMEOUT_SECONDS": str(settings.startup_seconds),
    }


def prefect_database(settings: Settings) -> str:
    """Database of Prefect servers that juicer starts: the temporary one of a flow, and that of ``juicer ui``."""
    return f"sqlite+aiosqlite:///{settings.folder / 'prefect.db'}"


def prepare_environment(settings: Settings) -> bool:
    """Set what the user has not set; returns whether a running Prefect server will be used.

    Raises:
        ConfigError: If the address of a Prefect server is none.
        ServiceUnavailable: If a Prefect server is configured and does not answer.
    """
    for name, value in quiet_environment(settings).items():
        os.environ.setdefault(name, value)
    for name in EXTRA_LOGGERS:
        logging.getLogger(name).setLevel(logging.INFO)
    url = os.environ.get(API_VARIABLE) or _announced_api(settings.folder)
    if url:
        check_address(API_VARIABLE, url)
        os.environ[API_VARIABLE] = url
        check_reachable("Prefect server", url, f"start it, or unset {API_VARIABLE} to run without one")
        return True
    _ensure_folder(settings.folder)
    os.environ.setdefault(DATABASE_VARIABLE, prefect_database(settings))
    return False


def _announced_api(folder: Path) -> str | None:
    services = find_services(folder)
    return services.prefect_api if services and is_prefect_healthy(services) else None


def _ensure_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ServiceUnavailable(
            f"the data folder '{folder}' cannot be created ({error.strerror}); set JUICER_DATA to another one"
        ) from None
