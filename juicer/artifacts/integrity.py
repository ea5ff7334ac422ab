"""What makes a folder trustworthy: hashes of its files, and their arrival on the disk."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from pathlib import Path, PurePosixPath
from typing import NamedTuple

from juicer.artifacts.contents import checked_when_read, digest, known_digest
from juicer.artifacts.findings import Finding, Nature, is_litter
from juicer.artifacts.manifest import MANIFEST_NAME, FileEntry
from juicer.errors import ArtifactError
from juicer.text import printable

Digest = Callable[[Path], str]
"""Gives the SHA-256 of a file."""


def describe_files(folder: Path) -> tuple[FileEntry, ...]:
    """Hash every file below ``folder`` except its manifest and an operating system's litter, sorted by path.

    Raises:
        ArtifactError: If something else than plain files is there, which no hash could vouch for.
        OSError: If something cannot be read.
    """
    entries = [entry for entry in _walk(folder) if not entry.is_folder and not entry.is_litter]
    paths = sorted(entry.path for entry in entries if entry.path != MANIFEST_NAME)
    for path in paths:
        if not _is_plain(folder / path):
            raise ArtifactError(f"'{printable(path)}' cannot be part of an artifact: only plain files can")
    return tuple(FileEntry(path, (folder / path).stat().st_size, digest(folder / path)) for path in paths)


def find_problems(folder: Path, expected: Sequence[FileEntry]) -> list[Finding]:
    """Compare a folder with the files it should hold, to the last byte.

    Returns:
        A finding that names the file for every difference.
    """
    return _find(folder, expected, lambda entry: digest)


def find_obstacles(folder: Path, expected: Sequence[FileEntry], read: Collection[str] | None = None) -> list[Finding]:
    """Compare a folder with the files it should hold, as far as is needed before it is read.

    Every file must be there, of its size and readable, and none else. Contents are compared once a process; not at all
    those of array chunks with checksums of their own, which whoever reads the array compares.

    Args:
        folder: The folder.
        expected: The files it should hold.
        read: Paths of the files that are going to be read; all if None.

    Returns:
        A finding that names the file for every difference.
    """
    trusted = checked_when_read(folder, [entry.path for entry in expected])

    def choose(entry: FileEntry) -> Digest | None:
        return None if entry.path in trusted or (read is not None and entry.path not in read) else known_digest

    return _find(folder, expected, choose)


def _find(folder: Path, expected: Sequence[FileEntry], choose: Callable[[FileEntry], Digest | None]) -> list[Finding]:
    known = {entry.path for entry in expected} | {MANIFEST_NAME}
    needed = _folders_above(known)
    unread: list[Finding] = []
    present = sorted(_walk(folder, unread, known | needed))
    inhabited = _folders_above(entry.path for entry in present)
    findings = [finding for entry in expected if (finding := _compare(folder, entry, choose(entry)))]
    for entry in present:
        if entry.path in needed and not entry.is_folder:
            findings.append(Finding(Nature.DAMAGE, f"folder '{printable(entry.path)}' was replaced by something else"))
        elif entry.path not in known | needed | inhabited:
            findings.append(describe_extra(entry.path, is_folder=entry.is_folder))
    return findings + unread


def wrong_size(entry: FileEntry, size: int) -> Finding:
    """A file that has another size than it should have."""
    return Finding(Nature.DAMAGE, f"file '{printable(entry.path)}' has {size} bytes instead of {entry.bytes}")


def describe_extra(path: str, *, is_folder: bool = False) -> Finding:
    """Something that does not belong to an artifact."""
    # Nothing can be read from an empty folder.
    nature = Nature.LITTER if is_folder or any(map(is_litter, path.split("/"))) else Nature.STRAY
    return Finding(nature, f"{'folder' if is_folder else 'file'} '{printable(path)}' does not belong to it")


def sync_tree(folder: Path) -> None:
    """Force every file and folder from ``folder`` downwards onto the disk."""
    for entry in _walk(folder):
        # What is no plain file was refused before, or is litter.
        if entry.is_folder or _is_plain(folder / entry.path):
            sync(folder / entry.path)
    sync(folder)


def sync(path: Path) -> None:
    """Force one file, or the entries of one folder, onto the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _compare(folder: Path, entry: FileEntry, digest: Digest | None) -> Finding | None:
    path, name = folder / entry.path, printable(entry.path)
    try:
        if not _is_plain(path):
            return Finding(Nature.DAMAGE, f"file '{name}' was replaced by something else")
        if (size := path.stat().st_size) != entry.bytes:
            return wrong_size(entry, size)
        if digest is None:
            if not os.access(path, os.R_OK):
                raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
        elif digest(path) != entry.sha256:
            return Finding(Nature.DAMAGE, f"file '{name}' has other content than when it was written")
    except (FileNotFoundError, NotADirectoryError):
        return Finding(Nature.DAMAGE, f"file '{name}' is missing")
    except OSError as error:
        # What the disk itself has lost is lost; what somebody forbids is not.
        nature = Nature.DAMAGE if error.errno == errno.EIO else Nature.UNREADABLE
        return Finding(nature, f"file '{name}' cannot be read ({error.strerror})")
    return None


class _Entry(NamedTuple):
    """What lies below a folder: POSIX path within it; links count as files, and litter is not looked into."""

    path: str
    is_folder: bool
    is_litter: bool


def _walk(folder: Path, unread: list[Finding] | None = None, wanted: Collection[str] = frozenset()) -> Iterator[_Entry]:
    """Everything below a folder.

    Args:
        folder: Where to begin.
        unread: Gets a finding for every folder that cannot be read; without it, that raises.
        wanted: Paths that are no litter, whatever their names.
    """
    waiting = [""]
    while waiting:
        parent = waiting.pop()
        try:
            with os.scandir(folder / parent) as children:
                entries = [_Entry(parent + each.name, each.is_dir(follow_symlinks=False), False) for each in children]
        except OSError as error:
            if unread is None:
                raise
            where = f"folder '{printable(parent.rstrip('/'))}'" if parent else "its folder"
            unread.append(Finding(Nature.UNREADABLE, f"{where} cannot be read ({error.strerror})"))
            continue
        for entry in entries:
            if entry.path not in wanted and is_litter(PurePosixPath(entry.path).name):
                yield entry._replace(is_litter=True)
                continue
            yield entry
            if entry.is_folder:
                waiting.append(f"{entry.path}/")


def _folders_above(paths: Iterable[str]) -> set[str]:
    return {str(folder) for path in paths for folder in PurePosixPath(path).parents} - {"."}


def _is_plain(path: Path) -> bool:
    return stat.S_ISREG(path.lstat().st_mode)
