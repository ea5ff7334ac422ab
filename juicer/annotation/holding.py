"""A file of versions as it was when a run began: people go on annotating while models are trained."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

from juicer.annotation.versions import MOST_BYTES
from juicer.errors import InvalidLabels
from juicer.reading import read_bounded
from juicer.text import printable


def hold(path: Path, folder: Path) -> Path:
    """A copy of a file of versions that never changes; the same for the same content.

    Args:
        path: The file.
        folder: Where copies are kept, so that what was made of them can be made again.

    Raises:
        InvalidLabels: If the file cannot be read, or its copy not be written.
    """
    try:
        content = read_bounded(path, MOST_BYTES)
        copy = folder / hashlib.sha256(content).hexdigest()[:16] / path.name
        if not copy.exists():
            copy.parent.mkdir(parents=True, exist_ok=True)
            draft = copy.with_name(f".{path.name}.{os.getpid()}.draft")
            draft.write_bytes(content)
            draft.replace(copy)
    except OSError as error:
        place = error.filename if isinstance(error.filename, str) else path
        reason = error.strerror or error
        raise InvalidLabels(f"annotations '{printable(path)}' cannot be used: '{printable(place)}': {reason}") from None
    return copy
