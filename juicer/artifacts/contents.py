"""Contents of files: their hashes, remembered while nothing was written, and which contents need none to be trusted."""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from juicer.reading import open_plain, read_bounded

SETTLED_NS = 2_000_000_000
"""Age of a file's times from which on any later write changes them: on some file systems they count two seconds."""

MOST_METADATA_BYTES = 2**24
"""Of the description of an array: far more than there is to say."""

_ARRAY = "zarr.json"
_CHECKSUM = "crc32c"

_digests: dict[tuple[int, ...], str] = {}
"""What this process has read, by all that the file system says about it."""


def digest(path: Path) -> str:
    """SHA-256 of a plain file, in hexadecimal digits.

    Raises:
        OSError: If it cannot be read, or is not a plain file.
    """
    with open_plain(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def written(facts: os.stat_result) -> tuple[int, ...]:
    """What a write to a file changes of what the file system says about it."""
    return (facts.st_dev, facts.st_ino, facts.st_size, facts.st_mtime_ns, facts.st_ctime_ns)


def known_digest(path: Path) -> str:
    """The same, read again by this process only if the file was written since.

    A write changes the time of a file's last change, which nobody can set back. Bytes that the disk itself loses
    unnoticed are found by whatever reads them anew: another process, or `juicer verify`.

    Raises:
        OSError: If it cannot be read, or is not a plain file.
    """
    before = time.time_ns()
    facts = path.stat()
    key = written(facts)
    if key in _digests:
        return _digests[key]
    found = digest(path)
    # A write just after the reading might leave the times as they are.
    if before - max(facts.st_mtime_ns, facts.st_ctime_ns) > SETTLED_NS:
        _digests[key] = found
    return found


def checked_when_read(folder: Path, paths: Sequence[str]) -> set[str]:
    """Files that need no other check than the one that happens when they are read: chunks with checksums of their own.

    Args:
        folder: Where they are.
        paths: POSIX paths of all files within it.
    """
    arrays = [path.removesuffix(_ARRAY) for path in paths if path.endswith(f"/{_ARRAY}")]
    chunks = tuple(f"{array}c/" for array in arrays if _has_checksums(folder / array / _ARRAY))
    return {path for path in paths if path.startswith(chunks)} if chunks else set()


def _has_checksums(path: Path) -> bool:
    """Whether an array of Zarr says that its chunks end with a checksum, and so do the parts of its shards."""
    try:
        codec = json.loads(read_bounded(path, MOST_METADATA_BYTES))["codecs"][-1]
        if codec["name"] == "sharding_indexed":
            inner = codec["configuration"]
            return all(_is_checksum(inner[codecs][-1]) for codecs in ("codecs", "index_codecs"))
        return _is_checksum(codec)
    # Whatever else it may be is compared as a whole.
    except (OSError, ValueError, RecursionError, LookupError, TypeError):
        return False


def _is_checksum(codec: Any) -> bool:
    return bool(codec["name"] == _CHECKSUM)
