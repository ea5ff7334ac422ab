"""Where running Prefect and MLflow servers are: written down by ``juicer ui``, found by flows."""

from __future__ import annotations

import json
import socket
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from urllib.parse import urlsplit

from juicer.errors import ConfigError, ServiceUnavailable

SERVICES_FILE = ".services.json"
LOOPBACK = "127.0.0.1"
HEALTH_SECONDS = 2.0


@dataclass(frozen=True)
class Services:
    """Addresses of the servers that ``juicer ui`` started.

    Attributes:
        prefect: Base address of the Prefect server.
        mlflow: Base address of the MLflow server.
    """

    prefect: str
    mlflow: str

    @property
    def prefect_api(self) -> str:
        """Address of Prefect's API."""
        return f"{self.prefect}/api"


@contextmanager
def announced(folder: Path, services: Services) -> Iterator[None]:
    """Tell flows about servers for the length of a block."""
    path = folder / SERVICES_FILE
    folder.mkdir(parents=True, exist_ok=True)
    draft = path.with_suffix(".draft")
    draft.write_text(json.dumps(asdict(services)) + "\n")
    draft.replace(path)
    try:
        yield
    finally:
        if find_services(folder) == services:
            path.unlink(missing_ok=True)


def find_services(folder: Path) -> Services | None:
    """Servers that were announced; they may be gone by now."""
    try:
        return Services(**json.loads((folder / SERVICES_FILE).read_text()))
    except (OSError, ValueError, TypeError):
        return None


def is_prefect_healthy(services: Services) -> bool:
    """Whether the announced Prefect server answers."""
    return _answers(f"{services.prefect_api}/health")


def is_mlflow_healthy(services: Services) -> bool:
    """Whether the announced MLflow server answers."""
    return _answers(f"{services.mlflow}/health")


def check_address(variable: str, url: str) -> None:
    """Refuse a text that names no web server.

    Raises:
        ConfigError: Naming the environment variable that holds it.
    """
    try:
        parts = urlsplit(url)
        names_server = parts.scheme in ("http", "https") and bool(parts.hostname) and parts.port != 0
    except ValueError:
        names_server = False
    if not names_server:
        raise ConfigError(f"environment variable {variable}: '{url}' is no address; write it as http://HOST:PORT/api")


def check_reachable(name: str, url: str, remedy: str) -> None:
    """Refuse a server that nobody answers for.

    Raises:
        ServiceUnavailable: If no connection can be made.
    """
    parts = urlsplit(url)
    port = parts.port or (443 if parts.scheme == "https" else 80)
    try:
        socket.create_connection((parts.hostname or LOOPBACK, port), timeout=HEALTH_SECONDS).close()
    except OSError as error:
        reason = error.strerror or str(error)
        raise ServiceUnavailable(f"the {name} at '{url}' does not answer ({reason}); {remedy}") from None


def choose_port(wanted: int | None, preferred: int, name: str) -> int:
    """A free port on loopback: the wanted one or none, else the preferred one if it is free, else any.

    Raises:
        ServiceUnavailable: If the wanted port is in use.
    """
    if wanted is not None:
        if not _is_free(wanted):
            raise ServiceUnavailable(
                f"port {wanted} for {name} is in use; choose another one, or none to have one found"
            )
        return wanted
    if _is_free(preferred):
        return preferred
    with socket.socket() as probe:
        probe.bind((LOOPBACK, 0))
        port: int = probe.getsockname()[1]
        return port


def _is_free(port: int) -> bool:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((LOOPBACK, port))
        except OSError:
            return False
    return True


def _answers(url: str) -> bool:
    try:
        with urllib.request.urlopen(url, timeout=HEALTH_SECONDS) as response:
            return bool(response.status == 200)
    except (OSError, urllib.error.URLError, ValueError):
        return False
