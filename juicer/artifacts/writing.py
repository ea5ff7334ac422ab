"""Turns the ways a disk can refuse a write into one sentence."""

from __future__ import annotations

import errno
import os
import pwd
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from juicer.errors import StoreNotWritable
from juicer.text import printable

_DISK = {
    errno.ENOSPC: "the disk is full; free some space",
    errno.EDQUOT: "the disk quota is used up; free some space",
    errno.EFBIG: "a file became larger than this system allows; see `ulimit -f` or choose another file system",
    errno.EROFS: "the file system is read-only; mount it for writing or choose another place",
    errno.EIO: "the disk reports an input/output error; check it or choose another place",
    errno.ENOLCK: "its file system offers no locks; choose another place",
}
"""What is wrong with a whole disk, wherever on it the write went."""

_PLACE = {
    errno.ENOENT: "it was removed while it was in use; run the command again",
    errno.ENOTDIR: "a file stands where a folder is needed; choose another place",
    errno.EEXIST: "a file stands where a folder is needed; choose another place",
    errno.EISDIR: "a folder stands where a file is needed; move it away",
    errno.ENOTEMPTY: "a folder stands where another is needed; move it away",
    errno.ELOOP: "a link stands where a file or folder is needed; remove it",
    errno.EXDEV: "it lies on another file system than the rest of the store; link the whole store there instead",
    errno.ENAMETOOLONG: "the path is too long; choose a shorter place",
}
"""What is wrong with one place, and therefore the store's business only below its root."""


@contextmanager
def explained(root: Path) -> Iterator[None]:
    """Run a block that writes below ``root``; refusals of the disk become :class:`StoreNotWritable`."""
    try:
        yield
    except OSError as error:
        reason = disk_refusal(error, root)
        if reason is None:
            raise
        raise StoreNotWritable(f"the artifact store in '{root}' cannot be written: {reason}") from error


def disk_refusal(error: OSError, root: Path) -> str | None:
    """Why a disk refuses a write below ``root``, and what helps; none if the disk is not to blame."""
    return _DISK.get(error.errno or 0) or _trouble_with_place(error, root)


def is_of_disk(error: BaseException, root: Path) -> bool:
    """Whether an error is the refusal of a disk, rather than of something that lies beyond the network."""
    local = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)
    return isinstance(error, OSError) and (error.errno in local or _is_below(error.filename, root))


def _trouble_with_place(error: OSError, root: Path) -> str | None:
    if error.errno is None or not _is_below(error.filename, root):
        return None
    place = _culprit(error)
    if error.errno in (errno.EACCES, errno.EPERM):
        blocked = next(path for path in (place, *place.parents) if os.path.lexists(path))
        return (
            f"permission is denied: user '{_user()}' may not write in '{printable(blocked)}'; "
            "change its owner or choose another place"
        )
    if error.errno == errno.ENOENT and root.is_dir() and place.parent.is_dir():
        return None  # a file that nobody wrote is a defect, not the disk's doing
    known = _PLACE.get(error.errno) or f"{os.strerror(error.errno).lower()}; choose another place"
    return f"'{printable(place)}': {known}"


def _culprit(error: OSError) -> Path:
    """Of the two places that a move is about, the one that refuses it."""
    places = [Path(name).absolute() for name in (error.filename, error.filename2) if isinstance(name, str | Path)]
    return next((place for place in places if not os.access(place.parent, os.W_OK | os.X_OK)), places[-1])


def _user() -> str:
    try:
        return pwd.getpwuid(os.geteuid()).pw_name
    except KeyError:
        return str(os.geteuid())


def _is_below(filename: object, root: Path) -> bool:
    """Also true for the folders above a root that does not exist yet: making it is what failed."""
    if not isinstance(filename, str | Path):
        return False
    path = Path(filename).absolute()
    return path.is_relative_to(root) or (not root.is_dir() and root.is_relative_to(path))
