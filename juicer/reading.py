"""Reading files that a user named: only plain files, and never more of them than is sensible.

A pipe, a device or a folder in place of a file would make a reader wait for ever, read without end, or fail with
words that nobody understands.
"""

from __future__ import annotations

import os
import stat
from io import BufferedReader
from pathlib import Path

_MORE = 2**16


class UnsuitableFile(OSError):
    """What a path names cannot be read as a file; ``strerror`` says why, as a clause."""

    def __init__(self, path: Path, reason: str) -> None:
        super().__init__(None, reason, str(path))
        self.strerror = reason


def open_plain(path: Path) -> BufferedReader:
    """Open a file for reading if it is a plain one, without waiting for anything.

    Raises:
        OSError: If it cannot be opened; :class:`UnsuitableFile` if it is a pipe, a device, a socket or a folder.
    """
    try:
        # Opening a pipe would wait for a writer.
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except ValueError:
        raise UnsuitableFile(path, "its name holds a null character") from None
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise UnsuitableFile(path, "it is not a plain file")
    return os.fdopen(descriptor, "rb")


def read_bounded(path: Path, most_bytes: int) -> bytes:
    """Content of a plain file that may be so large and no larger.

    Raises:
        OSError: If it cannot be read; :class:`UnsuitableFile` if it is not a plain file, or too large.
    """
    with open_plain(path) as file:
        # Memory is asked for by what the file says of its size: a small one must not cost what a large one may.
        size = os.fstat(file.fileno()).st_size
        content = b""
        while size <= most_bytes:
            content += file.read(size + 1 - len(content))
            if len(content) <= size:
                return content
            # Somebody appends to it.
            size = max(len(content), min(len(content) + _MORE, most_bytes))
    raise UnsuitableFile(path, f"it is larger than {most_bytes:,} bytes")
