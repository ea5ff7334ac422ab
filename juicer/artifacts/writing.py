"""Turns the ways a disk can refuse a write into one sentence."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from juicer.errors import StoreNotWritable

_DISK = {
    errno.ENOSPC: "the disk is full",
    errno.EDQUOT: "the disk quota is used up",
    errno.EROFS: "the file system is read-only",
    errno.EIO: "the disk reports an input/output error",
}
_PLACE = {
    errno.EACCES: "permission is denied",
    errno.EPERM: "permission is denied",
    errno.ENOTDIR: "it is not a folder",
    errno.EEXIST: "it is not a folder",
}


@contextmanager
def explained(root: Path) -> Iterator[None]:
    """Run a block that writes below ``root``; refusals of the disk become :class:`StoreNotWritable`.

    Refusals that concern one place, such as a denied permission, count only below ``root``: the block may well
    read files of the user elsewhere, about which the store has nothing to say.
    """
    try:
        yield
    except OSError as error:
        reason = _DISK.get(error.errno or 0)
        if reason is None and _is_below(error.filename, root):
            reason = _PLACE.get(error.errno or 0)
        if reason is None:
            raise
        raise StoreNotWritable(
            f"the artifact store '{root}' cannot be written: {reason}; free space, mend its permissions or choose another store"
        ) from error


def _is_below(filename: object, root: Path) -> bool:
    return isinstance(filename, str | Path) and Path(filename).absolute().is_relative_to(root)
