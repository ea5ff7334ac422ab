"""Which encoders can be used on this machine: published weights, where they lie, and where the others come from."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from juicer.policy.pretrained.files import places, remedy
from juicer.policy.pretrained.known import KNOWN, ROWS, Row
from juicer.reading import open_plain


class FileState(StrEnum):
    """What is known of the file that an encoder needs."""

    NONE = "none needed"
    PRESENT = "present"
    MISSING = "missing"
    UNPINNED = "present, digest unpublished"
    DIFFERS = "another file"
    UNREADABLE = "cannot be read"


@dataclass(frozen=True)
class EncoderFile:
    """An encoder and its weights on this machine.

    Attributes:
        row: The encoder.
        state: What is known of its file.
        path: Where it lies; where it belongs if it is missing; None if none is needed.
        size: Bytes, as found or else as published, if either is known.
        sha256: Digest of what was found; empty if nothing was.
        remedy: What to do to have it; empty if there is nothing to do.
    """

    row: Row
    state: FileState
    path: Path | None = None
    size: int | None = None
    sha256: str = ""
    remedy: str = ""


def examine_encoders(folder: Path) -> Iterator[EncoderFile]:
    """Every encoder of the paper's Table VII, and ours, in order.

    Args:
        folder: Where files of weights are looked for first.
    """
    for row in ROWS:
        yield _examined(row, folder) if row.weights else EncoderFile(row, FileState.NONE)


def _examined(row: Row, folder: Path) -> EncoderFile:
    known = KNOWN[row.weights]
    found = [each for path in places(known.file, folder) if (each := _looked_at(row, path))]
    right = (each for each in found if each.state in (FileState.PRESENT, FileState.UNPINNED))
    missing = EncoderFile(row, FileState.MISSING, folder / known.file, known.size, "", remedy(known.file, folder))
    return next(right, found[0] if found else missing)


def _looked_at(row: Row, path: Path) -> EncoderFile | None:
    """What is known of a place; None if there is nothing."""
    known = KNOWN[row.weights]
    try:
        with open_plain(path) as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
            size = file.tell()
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        return EncoderFile(row, FileState.UNREADABLE, path, remedy=f"see to '{path}': {error.strerror or error}")
    if known.sha256 is None:
        written = f"weights: {{file: {known.file}, sha256: {digest}, licence: {known.licence}}}"
        return EncoderFile(row, FileState.UNPINNED, path, size, digest, f"write {written}, if you trust its origin")
    if digest == known.sha256:
        return EncoderFile(row, FileState.PRESENT, path, size, digest)
    return EncoderFile(
        row, FileState.DIFFERS, path, size, digest, f"remove '{path}' and download it again, {known.url}"
    )
