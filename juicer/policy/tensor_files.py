"""Opening safetensors files that others may have written: plain, of a bounded size, looked at before they are read."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

from safetensors import SafetensorError, safe_open

from juicer.errors import InvalidCheckpoint
from juicer.reading import open_plain

MOST_HEADER_BYTES = 1_000_000
"""Names, types and shapes of the tensors; a policy of a hundred blocks needs a tenth of it."""
_LENGTH_BYTES = 8


@contextmanager
def opened_tensors(path: Path, framework: Literal["pt", "numpy"], most_bytes: int) -> Iterator[Any]:
    """A safetensors file, of which nothing but its header has been read.

    Args:
        path: The file; a link to one is refused, as it leads out of the checkpoint.
        framework: What its tensors shall be read as.
        most_bytes: Size of all tensors together that is still sensible.

    Raises:
        InvalidCheckpoint: If it is no such file, or the block fails to read a tensor from it.
    """
    try:
        _check(path, most_bytes)
        with safe_open(path, framework=framework) as file:
            yield file
    except OSError as error:
        raise InvalidCheckpoint(f"'{path}' cannot be read: {error.strerror or error}") from None
    except (SafetensorError, KeyError, ValueError, TypeError, OverflowError) as error:
        raise InvalidCheckpoint(f"'{path}' cannot be read: {error}") from None


def _check(path: Path, most_bytes: int) -> None:
    if path.is_symlink():
        raise InvalidCheckpoint(f"'{path}' is a link; a checkpoint holds its files itself")
    with open_plain(path) as file:
        header = int.from_bytes(file.read(_LENGTH_BYTES), "little")
        size = file.seek(0, 2)
    if header > MOST_HEADER_BYTES or header + _LENGTH_BYTES > size:
        raise InvalidCheckpoint(f"'{path}' cannot be read: it is not a safetensors file, or damaged")
    if size - header > most_bytes + _LENGTH_BYTES:
        raise InvalidCheckpoint(f"'{path}' does not fit its own configuration: it is larger than {most_bytes:,} bytes")
