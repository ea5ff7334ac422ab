"""Whether a disk has room for what is going to be written, asked before hours of work."""

from __future__ import annotations

import shutil
from pathlib import Path

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


def _size(number: float) -> str:
    return f"{number / 1e9:.1f} GB" if number >= 1e9 else f"{number / 1e6:.1f} MB"
