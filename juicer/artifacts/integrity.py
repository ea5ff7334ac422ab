"""What makes a folder trustworthy: hashes of its files, and their arrival on the disk."""

from __future__ import annotations

import hashlib
import os
import stat
from collections.abc import Iterator, Sequence
from pathlib import Path

from juicer.artifacts.manifest import MANIFEST_NAME, FileEntry
from juicer.errors import ArtifactError


class DamageError(Exception):
    """Files of an artifact are not what they should be; the message is a clause that names the file."""


class UnreadableError(DamageError):
    """A file that may be whole cannot be read."""


def describe_files(folder: Path) -> tuple[FileEntry, ...]:
    """Hash every file below ``folder`` except its manifest, sorted by path.

    Raises:
        ArtifactError: If something else than plain files is there, which no hash could vouch for.
    """
    paths = sorted(_payload(folder))
    for path in paths:
        if not _is_plain(folder / path):
            raise ArtifactError(f"'{path}' cannot be part of an artifact: only plain files can")
    return tuple(_describe(folder, path) for path in paths)


def find_problems(folder: Path, expected: Sequence[FileEntry]) -> list[str]:
    """Compare a folder with the files it should hold; every difference is one clause that names the file."""
    known = {entry.path for entry in expected}
    extra = sorted(set(_payload(folder)) - known)
    problems = [problem for entry in expected if (problem := _find_problem(folder, entry))]
    return problems + [f"file '{path}' does not belong to it" for path in extra]


def sync_tree(folder: Path) -> None:
    """Force every file and folder from ``folder`` downwards onto the disk."""
    for parent, _, names in os.walk(folder):
        for name in names:
            sync(Path(parent, name))
        sync(Path(parent))


def sync(path: Path) -> None:
    """Force one file, or the entries of one folder, onto the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _find_problem(folder: Path, entry: FileEntry) -> str | None:
    path = folder / entry.path
    try:
        if not _is_plain(path):
            return f"file '{entry.path}' was replaced by something else"
        if (size := path.stat().st_size) != entry.bytes:
            return f"file '{entry.path}' has {size} bytes instead of {entry.bytes}"
        if _describe(folder, entry.path) != entry:
            return f"file '{entry.path}' has other content than when it was written"
    except (FileNotFoundError, NotADirectoryError):
        return f"file '{entry.path}' is missing"
    except OSError as error:
        return f"file '{entry.path}' cannot be read ({error.strerror})"
    return None


def _payload(folder: Path) -> Iterator[str]:
    """POSIX paths of all that is neither a folder nor the manifest."""
    for parent, folders, names in os.walk(folder):
        links = [name for name in folders if Path(parent, name).is_symlink()]
        for name in names + links:
            path = Path(parent, name).relative_to(folder).as_posix()
            if path != MANIFEST_NAME:
                yield path


def _is_plain(path: Path) -> bool:
    return stat.S_ISREG(path.lstat().st_mode)


def _describe(folder: Path, path: str) -> FileEntry:
    with (folder / path).open("rb") as file:
        digest = hashlib.file_digest(file, "sha256")
        return FileEntry(path, file.tell(), digest.hexdigest())
