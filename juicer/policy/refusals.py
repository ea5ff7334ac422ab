"""A system's refusal to write tensors, told like that of any other write."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from safetensors import SafetensorError

_NUMBER = re.compile(r"\(os error ([0-9]+)\)")


@contextmanager
def refusals_as_os_errors(path: Path) -> Iterator[None]:
    """Run a block in which safetensors writes a file.

    The library has an error of its own for a full disk, which nobody who explains full disks knows.

    Raises:
        OSError: If the system refuses the write.
    """
    try:
        yield
    except SafetensorError as error:
        number = _NUMBER.search(str(error))
        if number is None:
            raise
        raise OSError(int(number[1]), os.strerror(int(number[1])), str(path)) from error
