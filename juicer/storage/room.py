"""Room on a disk: asked for before hours of work, and taken at once where a file is mapped into memory."""

from __future__ import annotations

import errno
import math
import os
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from juicer.errors import StoreNotWritable
from juicer.text import printable


def require_room(folder: Path, needed: float, what: str) -> None:
    """Refuse to begin what a disk has no room for.

    Args:
        folder: Existing folder on the disk.
        needed: Bytes that will be written.
        what: What they are, in the plural.

    Raises:
        StoreNotWritable: With both sizes.
    """
    free = shutil.disk_usage(folder).free
    if needed > free:
        raise StoreNotWritable(
            f"{what} take about {_size(needed)}, and the disk of '{printable(folder)}' has {_size(free)} left; "
            "make room there, or look at fewer or smaller views"
        )


def new_images(path: Path, shape: Sequence[int]) -> np.memmap[Any, np.dtype[np.uint8]]:
    """An array in a new file, to be written through memory.

    All of its room is taken now: a disk that is full only when a page is written kills the process with a signal.

    Raises:
        StoreNotWritable: If there is too little room.
    """
    size = math.prod(shape)
    try:
        with path.open("wb") as file:
            os.posix_fallocate(file.fileno(), 0, size)
    except OSError as error:
        path.unlink(missing_ok=True)
        remedy = "; make room there" if error.errno in (errno.ENOSPC, errno.EDQUOT) else ""
        raise StoreNotWritable(
            f"'{printable(path)}' of {_size(size)} cannot be written: {error.strerror or error}{remedy}"
        ) from None
    return np.memmap(path, np.uint8, "r+", shape=tuple(shape))


def _size(number: float) -> str:
    return f"{number / 1e9:.1f} GB" if number >= 1e9 else f"{number / 1e6:.1f} MB"
