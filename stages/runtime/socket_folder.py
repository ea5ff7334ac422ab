"""Where multiprocessing keeps its sockets: in a folder whose path is short enough, and which goes with its process.

Processes of stages are asked for through a socket, whose path may have 107 letters; a long ``TMPDIR`` leaves too few.
What a killed process left behind is removed by the next one that starts.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import tempfile
from collections.abc import Iterator
from multiprocessing.util import Finalize, get_temp_dir
from pathlib import Path

from juicer.errors import ServiceUnavailable

PREFIX = "juicer-"
LONGEST_BASE = 60
"""Letters of a path to which the names of a socket and of its folders are added."""

_SHORT = (Path("/tmp"), Path("/var/tmp"))
_LOCK = ".lock"
_held: list[int] = []
"""Locks of this process; the kernel frees them when it ends, however it ends."""


def make_socket_folder() -> Path:
    """Make the folder, to be called before multiprocessing makes its own; it is removed at exit.

    Raises:
        ServiceUnavailable: If there is no place for it.
    """
    base = _base()
    for left in _left_behind(base):
        shutil.rmtree(left, ignore_errors=True)
    try:
        folder = _make(base)
    except OSError as error:
        raise ServiceUnavailable(
            f"no temporary folder can be made in '{base}' ({error.strerror}); free some space there, or set TMPDIR to "
            f"another folder whose path has at most {LONGEST_BASE} letters"
        ) from None
    # Asked for now, multiprocessing makes its folder within this one, and keeps to it.
    usual, tempfile.tempdir = tempfile.tempdir, str(folder)
    get_temp_dir()
    tempfile.tempdir = usual
    # After multiprocessing has removed what it keeps there, which it does with priority -100.
    Finalize(None, shutil.rmtree, args=(folder,), kwargs={"ignore_errors": True}, exitpriority=-200)
    return folder


def _base() -> Path:
    """Where the system's temporary files go, or a place with a shorter path."""
    try:
        usual = Path(tempfile.gettempdir()).absolute()
    except FileNotFoundError as error:
        raise ServiceUnavailable(
            f"there is no place for temporary files ({error.strerror}); free some space, or set TMPDIR to a folder "
            "that can be written"
        ) from None
    if len(os.fsencode(usual)) <= LONGEST_BASE:
        return usual
    usable = [path for path in _SHORT if os.access(path, os.W_OK | os.X_OK)]
    if not usable:
        raise ServiceUnavailable(
            f"the path of the folder for temporary files, '{usual}', is too long for sockets; set TMPDIR to one with "
            f"at most {LONGEST_BASE} letters"
        )
    return usable[0]


def _make(base: Path) -> Path:
    draft = Path(tempfile.mkdtemp(prefix=f".{PREFIX}", dir=base))
    descriptor = os.open(draft / _LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    fcntl.flock(descriptor, fcntl.LOCK_EX)
    _held.append(descriptor)
    # Visible to whoever tidies up only now, when its lock is held.
    return draft.rename(draft.with_name(draft.name.removeprefix(".")))


def _left_behind(base: Path) -> Iterator[Path]:
    """Folders of ours whose process is gone."""
    for folder in base.glob(f"{PREFIX}*/"):
        try:
            if folder.is_symlink() or folder.stat().st_uid != os.getuid():
                continue
            descriptor = os.open(folder / _LOCK, os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW)
        except OSError:
            continue
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            continue
        else:
            yield folder
        finally:
            os.close(descriptor)
