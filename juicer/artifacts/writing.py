"""Turns the ways a disk can refuse a write into one sentence."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from juicer.errors import StoreNotWritable

_DISK = {
    errno.ENOSPC: "the disk is full; free some space",
    errno.EDQUOT: "the disk quota is used up; free some space",
    errno.EROFS: "the file system is read-only; choose another place",
    errno.EIO: "the disk reports an input/output error; check it or choose another place",
}
"""What is wrong with a whole disk, wherever on it the write went."""

_PLACE = {
    errno.EACCES: "permission is denied; change its owner or choose another place",
    errno.EPERM: "permission is denied; change its owner or choose another place",
    errno.ENOTDIR: "a file stands where a folder is needed; choose another place",
    errno.EEXIST: "a file stands where a folder is needed; choose another place",
}
"""What is wrong with one place, and therefore the store's business only below its root."""


@contextmanager
def explained(root: Path) -> Iterator[None]:
    """Run a block that writes below ``root``; refusals of the disk become :class:`StoreNotWritable`."""
    try:
        yield
    except OSError as error:
        reason = _DISK.get(error.errno or 0)
        if reason is None and _is_below(error.filename, root):
            reason = _PLACE.get(error.errno or 0)
        if reason is None:
            raise
        raise StoreNotWritable(f"the artifact store in '{root}' cannot be written: {reason}") from error


def _is_below(filename: object, root: Path) -> bool:
    """Also true for the folders above a root that does not exist yet: making it is what failed."""
    if not isinstance(filename, str | Path):
        return False
    path = Path(filename).absolute()
    return path.is_relative_to(root) or (not root.is_dir() and root.is_relative_to(path))
