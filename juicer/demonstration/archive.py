"""Reading ``.npz`` archives that anybody may have made: every size is known and bounded before anything is unpacked.

An archive of a few megabytes can unfold into gigabytes, and say something else about its size than is true. So the
archive's directory and the header of each array come first; they are short, and judged before any array is read.
"""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from juicer.errors import RejectedLog
from juicer.text import printable

MOST_FILE_BYTES = 128 * 2**20
"""Largest archive that is read."""

MOST_ARRAY_BYTES = 128 * 2**20
"""Most bytes that the arrays of one archive may take once they are unpacked."""

MOST_ENTRIES = 64
"""Most entries an archive may have, those of other programs among them."""

_ENDING = ".npy"
_MOST_HEADER_LETTERS = 1_000
_LARGEST_SIZE = 2**40
_MOST_BYTES_AT_ONCE = 2**20
_IS_ENCRYPTED = 0x1
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_PLAIN_KINDS = "biufU"


@dataclass(frozen=True)
class ArrayHeader:
    """What an archive says about one of its arrays, before it is unpacked.

    Attributes:
        dtype: Type of its entries.
        shape: Its shape.
    """

    dtype: np.dtype[Any]
    shape: tuple[int, ...]

    @property
    def num_bytes(self) -> int:
        """Its size once it is unpacked."""
        return math.prod(self.shape) * self.dtype.itemsize


class Archive:
    """Some arrays of an ``.npz`` archive; whatever else is in it is not touched.

    Attributes:
        specs: Type and shape of each, by name.
    """

    def __init__(self, content: bytes, names: Iterable[str], optional: Iterable[str] = ()) -> None:
        """Read the directory, and the headers of the named arrays.

        Args:
            content: The whole file.
            names: Arrays that must be there.
            optional: Arrays that may be.

        Raises:
            RejectedLog: If it is no such archive, lacks an array, or is larger than is sensible.
        """
        self._entries: dict[str, zipfile.ZipInfo] = {}
        specs: dict[str, ArrayHeader] = {}
        with explained():
            self._zip = zipfile.ZipFile(_ShortReads(content))
            if len(self._zip.infolist()) > MOST_ENTRIES:
                raise RejectedLog(f"it has {len(self._zip.infolist()):,} entries; a log has at most {MOST_ENTRIES}")
            there = {info.filename for info in self._zip.infolist()}
            for name in (*names, *(name for name in optional if name + _ENDING in there)):
                self._entries[name] = self._find(name)
                specs[name] = self._spec(name)
        self.specs: Mapping[str, ArrayHeader] = specs
        total = sum(spec.num_bytes for spec in self.specs.values())
        if total > MOST_ARRAY_BYTES:
            raise RejectedLog(f"its arrays would take {total:,} bytes; a log has at most {MOST_ARRAY_BYTES:,}")

    def read(self, name: str) -> NDArray[Any]:
        """Unpack an array.

        Raises:
            RejectedLog: If it cannot be unpacked, or is of another size than it says.
        """
        with explained(), self._zip.open(self._entries[name]) as file:
            values: NDArray[Any] = npy.read_array(file, allow_pickle=False, max_header_size=_MOST_HEADER_LETTERS)
            # The checksum is compared at the end of the entry only.
            if file.read(1):
                raise RejectedLog(f"entry '{name}' holds more than its array; record it again")
            return values

    def _find(self, name: str) -> zipfile.ZipInfo:
        found = [info for info in self._zip.infolist() if info.filename == name + _ENDING]
        if not found:
            raise RejectedLog(f"entry '{name}' is missing; record it again")
        if len(found) > 1:
            raise RejectedLog(f"entry '{name}' is there {len(found)} times; record it again")
        if found[0].flag_bits & _IS_ENCRYPTED:
            raise RejectedLog(f"entry '{name}' is encrypted; save the log without a password")
        if found[0].compress_type not in _METHODS:
            raise RejectedLog(f"entry '{name}' is compressed in another way than numpy does; save it with numpy")
        return found[0]

    def _spec(self, name: str) -> ArrayHeader:
        entry = self._entries[name]
        with self._zip.open(entry) as file:
            spec = _read_spec(file)
            start = file.tell()
        if spec.dtype.hasobject:
            raise RejectedLog(f"it is no operator log: '{name}' holds pickled objects, which are never loaded")
        if spec.dtype.kind not in _PLAIN_KINDS or spec.dtype.shape:
            raise RejectedLog(f"array '{name}' must hold plain numbers, got {printable(spec.dtype)}")
        if not all(0 <= size < _LARGEST_SIZE for size in spec.shape):
            raise RejectedLog(f"array '{name}' has the impossible shape {printable(spec.shape)}")
        if entry.file_size != start + spec.num_bytes:
            raise RejectedLog(
                f"entry '{name}' has {entry.file_size:,} bytes where its array of shape {printable(spec.shape)} "
                f"needs {start + spec.num_bytes:,}; record it again"
            )
        return spec


def _read_spec(file: IO[bytes]) -> ArrayHeader:
    readers = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
    version = npy.read_magic(file)
    if version not in readers:
        raise RejectedLog(f"an array is in version {version[0]}.{version[1]} of numpy's format; save it with numpy")
    shape, _, dtype = readers[version](file, max_header_size=_MOST_HEADER_LETTERS)
    return ArrayHeader(dtype, shape)


@contextmanager
def explained() -> Iterator[None]:
    """Run a block that reads what may be anything; whatever it raises becomes a :class:`RejectedLog`."""
    try:
        yield
    except RejectedLog:
        raise
    except Exception as error:
        # What the readers of archives, arrays and JSON raise at hostile bytes is an open list.
        reason = " ".join(str(error).split()) or type(error).__name__
        raise RejectedLog(f"the file is truncated or no operator log ({printable(reason)})") from None


class _ShortReads(io.BytesIO):
    """A file that refuses to be read in pieces larger than an honest archive has.

    The size of an archive's directory is whatever the archive says, and each entry of it becomes an object.
    """

    def read(self, size: int | None = -1, /) -> bytes:
        left = len(self.getbuffer()) - self.tell()
        wanted = left if size is None or size < 0 else min(size, left)
        if wanted > _MOST_BYTES_AT_ONCE:
            raise RejectedLog(f"its directory takes {wanted:,} bytes; a log has at most {MOST_ENTRIES} entries")
        return super().read(size)
