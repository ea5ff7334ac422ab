"""Where running servers are: written down by ``juicer ui`` and ``juicer pages``, found by flows and by each other."""

from __future__ import annotations

import fcntl
import json
import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import ClassVar, TypeVar

from flows.running.data_folder import PRIVATE, write_private, writing
from juicer.reading import read_bounded

SERVICES_FILE = ".services.json"
_MOST_BYTES = 10_000


@dataclass(frozen=True)
class Announcement:
    """What a process says of the servers that it runs.

    Attributes:
        file: Name of the file in the data folder in which it says so.
        machine: Name of the machine they run on; on another one with the same data folder they are out of reach.
    """

    file: ClassVar[str]
    machine: str = field(default_factory=platform.node, kw_only=True)


@dataclass(frozen=True)
class Services(Announcement):
    """Addresses of the servers that ``juicer ui`` started.

    Attributes:
        prefect: Base address of the Prefect server.
        mlflow: Base address of the MLflow server.
    """

    file = SERVICES_FILE
    prefect: str
    mlflow: str

    @property
    def prefect_api(self) -> str:
        """Address of Prefect's API."""
        return f"{self.prefect}/api"


@dataclass(frozen=True)
class Pages(Announcement):
    """Address of the pages that ``juicer pages`` serves.

    Attributes:
        address: Base address, without the token.
    """

    file = ".pages.json"
    address: str


AnnouncementT = TypeVar("AnnouncementT", bound=Announcement)


@contextmanager
def only_one(folder: Path, kind: type[Announcement] = Services) -> Iterator[bool]:
    """Hold the place of those who serve a data folder, for the length of a block; gives whether it was free.

    The kernel frees it when the process ends, however it ends: an announcement that nobody stands behind is void, and
    nobody who has taken over the port is sent a password. What a killed process announced goes at once, before the new
    one has anything to announce.

    Raises:
        ServiceUnavailable: If the disk refuses the file or its lock.
    """
    path = _lock_file(folder, kind)
    with writing(path):
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, PRIVATE)
    try:
        with writing(path):
            is_free = _locks(descriptor, fcntl.LOCK_EX)
            if is_free:
                (folder / kind.file).unlink(missing_ok=True)
        yield is_free
    finally:
        os.close(descriptor)


@contextmanager
def announce(folder: Path, announcement: Announcement) -> Iterator[None]:
    """Tell others about servers for the length of a block, within that of :func:`only_one`.

    Raises:
        ServiceUnavailable: If the disk refuses.
    """
    path = folder / announcement.file
    write_private(path, json.dumps(asdict(announcement)) + "\n")
    try:
        yield
    finally:
        # What is left of it is void as soon as nobody holds the lock.
        with suppress(OSError):
            path.unlink()


def find_services(folder: Path) -> Services | None:
    """Prefect's and MLflow's servers if they are announced, and their process is there."""
    return _find(folder, Services)


def find_pages(folder: Path) -> str:
    """Address of the pages if they are announced, and their process is there; else empty."""
    found = _find(folder, Pages)
    return found.address if found else ""


def _find(folder: Path, kind: type[AnnouncementT]) -> AnnouncementT | None:
    try:
        found = kind(**json.loads(read_bounded(folder / kind.file, _MOST_BYTES)))
        descriptor = os.open(_lock_file(folder, kind), os.O_RDONLY | os.O_CLOEXEC)
        try:
            is_held = not _locks(descriptor, fcntl.LOCK_SH)
        finally:
            os.close(descriptor)
    except (OSError, ValueError, TypeError):
        return None
    are_texts = all(isinstance(value, str) for value in asdict(found).values())
    return found if is_held and are_texts and found.machine == platform.node() else None


def _lock_file(folder: Path, kind: type[Announcement]) -> Path:
    return (folder / kind.file).with_suffix(".lock")


def _locks(descriptor: int, kind: int) -> bool:
    try:
        fcntl.flock(descriptor, kind | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
