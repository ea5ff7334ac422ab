"""The folder for databases, records and addresses: whether it can be written, and what it is called in an address."""

from __future__ import annotations

import errno
import os
import pwd
import secrets
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from urllib.parse import quote

from flows.running.settings import Settings
from juicer.artifacts.store import ArtifactStore
from juicer.artifacts.writing import disk_refusal
from juicer.errors import ServiceUnavailable

PRIVATE = 0o600
"""Rights of files that only their owner may read."""

DATABASES = ("prefect.db", "mlflow.db")
_MEANINGFUL = str.maketrans({letter: quote(letter) for letter in "%?#"})
"""What an address does not take for a part of a path."""


def prepare_folder(settings: Settings) -> None:
    """Make the data folder, and a store on this machine, and see that both can be written.

    Raises:
        ServiceUnavailable: Naming the folder, or the file in it, and the right that is missing.
    """
    for folder in _folders(settings):
        _make(*folder)
    for name in DATABASES:
        path = settings.folder / name
        if path.exists() and not os.access(path, os.R_OK | os.W_OK):
            raise ServiceUnavailable(
                f"you have no right to write the file '{path}', which belongs to {_owner(path)}; ask for that right, "
                "or set JUICER_DATA to a folder of your own"
            )


def open_store(settings: Settings) -> ArtifactStore:
    """The artifact store of this process."""
    return ArtifactStore(settings.store_url, cache=settings.folder / "cache")


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Run a block that writes a file or folder of the data folder.

    Raises:
        ServiceUnavailable: If the disk refuses, with what helps.
    """
    try:
        yield
    except OSError as error:
        reason = disk_refusal(error, path.parent) or error.strerror or str(error)
        raise ServiceUnavailable(f"'{path}' cannot be written: {reason}") from None


def write_private(path: Path, text: str) -> None:
    """Write a file that only its owner can read, whole or not at all.

    Raises:
        ServiceUnavailable: If the disk refuses.
    """
    with private_draft(path, text) as draft, writing(path):
        draft.replace(path)


@contextmanager
def private_draft(path: Path, text: str) -> Iterator[Path]:
    """A file beside a path that only its owner can read, and that is removed at the end if it is still there then.

    Raises:
        ServiceUnavailable: If the disk refuses.
    """
    draft = path.with_name(f"{path.name}.{secrets.token_hex(4)}.draft")
    try:
        with writing(path):
            descriptor = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, PRIVATE)
            with os.fdopen(descriptor, "w") as file:
                file.write(text)
        yield draft
    finally:
        with suppress(OSError):
            draft.unlink()


def sqlite_address(driver: str, path: Path) -> str:
    """Address of a SQLite file, as SQLAlchemy reads it: whatever is in its path, the file is meant."""
    quoted = str(path).translate(_MEANINGFUL)
    if driver == "sqlite" and quoted != str(path):
        # The same driver by its whole name: for the short one, MLflow makes a folder of the address as it stands.
        driver = "sqlite+pysqlite"
    return f"{driver}:///{quoted}"


def _folders(settings: Settings) -> Iterator[tuple[str, Path, str]]:
    yield "data folder", settings.folder, "JUICER_DATA"
    if settings.store and "://" not in settings.store:
        yield "artifact store", Path(settings.store).expanduser().absolute(), "JUICER_STORE"


def _make(what: str, folder: Path, variable: str) -> None:
    remedy = f"set {variable} to another one"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ServiceUnavailable(
            f"the {what} '{folder}' cannot be created ({error.strerror} at '{_deepest(folder)}'); {remedy}"
        ) from None
    try:
        with tempfile.TemporaryFile(dir=folder, buffering=0) as file:
            file.write(b"juicer")  # a full disk takes an empty file
    except OSError as error:
        if error.errno in (errno.EACCES, errno.EPERM):
            reason = f"you have no right to write in it, as it belongs to {_owner(folder)}"
            remedy = f"ask for that right, or set {variable} to a folder of your own"
        elif error.errno == errno.EROFS:
            reason = "its file system is mounted read-only"
        else:
            reason = disk_refusal(error, folder) or error.strerror or str(error)
        raise ServiceUnavailable(f"the {what} '{folder}' cannot be written: {reason}; {remedy}") from None


def _deepest(folder: Path) -> Path:
    """The last part of a path that is there, which is what refuses."""
    return next((parent for parent in (folder, *folder.parents) if os.path.lexists(parent)), folder)


def _owner(path: Path) -> str:
    number = path.stat().st_uid
    if number == os.geteuid():
        return "you"
    try:
        return f"'{pwd.getpwuid(number).pw_name}'"
    except KeyError:
        return f"user {number}"
