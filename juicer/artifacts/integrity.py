"""What makes a folder trustworthy: hashes of its files, and their arrival on the disk."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator, Sequence
from pathlib import Path

from juicer.artifacts.manifest import MANIFEST_NAME, FileEntry


def describe_files(folder: Path) -> tuple[FileEntry, ...]:
    """Hash every file below ``folder`` except its manifest, sorted by path."""
    return tuple(_describe(folder, path) for path in sorted(_payload(folder)))


def find_problems(folder: Path, expected: Sequence[FileEntry]) -> list[str]:
    """Compare a folder with the files it should hold; every difference is one clause that names the file."""
    present = set(_payload(folder))
    problems = []
    for entry in expected:
        if entry.path not in present:
            problems.append(f"file '{entry.path}' is missing")
        elif (size := (folder / entry.path).stat().st_size) != entry.bytes:
            problems.append(f"file '{entry.path}' has {size} bytes instead of {entry.bytes}")
        elif _describe(folder, entry.path) != entry:
            problems.append(f"file '{entry.path}' has other content than when it was written")
    known = {entry.path for entry in expected}
    problems += [f"file '{path}' does not belong to it" for path in sorted(present - known)]
    return problems


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


def _payload(folder: Path) -> Iterator[str]:
    for parent, _, names in os.walk(folder):
        for name in names:
            path = Path(parent, name).relative_to(folder).as_posix()
            if path != MANIFEST_NAME:
                yield path


def _describe(folder: Path, path: str) -> FileEntry:
    with (folder / path).open("rb") as file:
        digest = hashlib.file_digest(file, "sha256")
        return FileEntry(path, file.tell(), digest.hexdigest())
