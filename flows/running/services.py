"""Where running Prefect and MLflow servers are: written down by ``juicer ui``, found by flows."""

from __future__ import annotations

import fcntl
import json
import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

from flows.running.data_folder import PRIVATE, write_private
from juicer.reading import read_bounded

SERVICES_FILE = ".services.json"
LOCK_FILE = ".services.lock"
_MOST_BYTES = 10_000


@dataclass(frozen=True)
class Services:
    """Addresses of the servers that ``juicer ui`` started.

    Attributes:
        prefect: Base address of the Prefect server.
        mlflow: Base address of the MLflow server.
        machine: Name of the machine they run on; on another one with the same data folder they are out of reach.
    """

    prefect: str
    mlflow: str
    machine: str = platform.node()

    @property
    def prefect_api(self) -> str:
        """Address of Prefect's API."""
        return f"{self.prefect}/api"


@contextmanager
def only_one(folder: Path) -> Iterator[bool]:
    """Hold the place of those who serve a data folder, for the length of a block; gives whether it was free.

    The kernel frees it when the process ends, however it ends: an announcement that nobody stands behind is void, and
    nobody who has taken over the port is sent a password.
    """
    descriptor = os.open(folder / LOCK_FILE, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, PRIVATE)
    try:
        yield _locks(descriptor, fcntl.LOCK_EX)
    finally:
        os.close(descriptor)


@contextmanager
def announce(folder: Path, services: Services) -> Iterator[None]:
    """Tell flows about servers for the length of a block, within that of :func:`only_one`."""
    path = folder / SERVICES_FILE
    write_private(path, json.dumps(asdict(services)) + "\n")
    try:
        yield
    finally:
        path.unlink(missing_ok=True)


def find_services(folder: Path) -> Services | None:
    """Servers that are announced, and whose process is there."""
    try:
        services = Services(**json.loads(read_bounded(folder / SERVICES_FILE, _MOST_BYTES)))
        descriptor = os.open(folder / LOCK_FILE, os.O_RDONLY | os.O_CLOEXEC)
    except (OSError, ValueError, TypeError):
        return None
    try:
        is_held = not _locks(descriptor, fcntl.LOCK_SH)
    finally:
        os.close(descriptor)
    are_texts = all(isinstance(value, str) for value in asdict(services).values())
    return services if is_held and are_texts and services.machine == platform.node() else None


def _locks(descriptor: int, kind: int) -> bool:
    try:
        fcntl.flock(descriptor, kind | fcntl.LOCK_NB)
    except OSError:
        return False
    return True
