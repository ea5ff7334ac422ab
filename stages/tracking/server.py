"""MLflow's server as an application, to be served by whoever decides whom it answers.

``mlflow server`` starts processes of its own, in front of which nothing can stand.
"""

from __future__ import annotations

import os
from collections.abc import Collection
from typing import TYPE_CHECKING

from juicer.errors import ConfigError, TrackingError

if TYPE_CHECKING:
    from starlette.types import ASGIApp


def create_app(hosts: Collection[str]) -> ASGIApp:
    """MLflow's server, ready to be served; reads the variables that ``mlflow server`` reads.

    Args:
        hosts: Host and port by which it may be reached.

    Raises:
        ConfigError: If no variable names its database.
        TrackingError: If the database cannot be used.
    """
    database = os.environ.get("MLFLOW_BACKEND_STORE_URI", "")
    if not database:
        raise ConfigError("MLflow's server needs a database; set MLFLOW_BACKEND_STORE_URI to its address")
    # Its own checks are a second line behind ours, and must know the same names.
    os.environ["MLFLOW_SERVER_ALLOWED_HOSTS"] = ",".join(sorted(hosts))
    os.environ["MLFLOW_SERVER_CORS_ALLOWED_ORIGINS"] = ",".join(
        f"{scheme}://{host}" for host in sorted(hosts) for scheme in ("http", "https")
    )
    destination = os.environ.get("MLFLOW_ARTIFACTS_DESTINATION", "")
    root = _tell_workers(database, os.environ.get("MLFLOW_DEFAULT_ARTIFACT_ROOT", ""), destination)
    from mlflow.server import handlers
    from mlflow.server.fastapi_app import app

    try:
        handlers.initialize_backend_stores(database, database, root)
    except Exception as error:
        raise TrackingError(f"MLflow's database cannot be used: {' '.join(str(error).split())[:300]}") from None
    application: ASGIApp = app
    return application


def _tell_workers(database: str, artifact_root: str, destination: str) -> str:
    """Set what the command ``mlflow server`` tells the processes that it starts; gives where new files go."""
    from mlflow.server import constants

    if not destination and not artifact_root:
        raise ConfigError(
            "MLflow's server needs a place for files; set MLFLOW_ARTIFACTS_DESTINATION to have it take and give them, "
            "or MLFLOW_DEFAULT_ARTIFACT_ROOT to a place that everybody reaches"
        )
    for name in (constants.SERVE_ARTIFACTS_ENV_VAR, constants.ARTIFACTS_DESTINATION_ENV_VAR):
        os.environ.pop(name, None)
    os.environ[constants.BACKEND_STORE_URI_ENV_VAR] = database
    os.environ[constants.REGISTRY_STORE_URI_ENV_VAR] = database
    os.environ[constants.ARTIFACT_ROOT_ENV_VAR] = root = artifact_root or "mlflow-artifacts:/"
    if destination:
        os.environ[constants.SERVE_ARTIFACTS_ENV_VAR] = "true"
        os.environ[constants.ARTIFACTS_DESTINATION_ENV_VAR] = destination
    return root
