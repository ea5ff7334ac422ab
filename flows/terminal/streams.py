"""Standard output and error that may go away, as into a full disk or a pipe whose reader has seen enough.

A run must not fail because nobody takes what it prints: the rest of its words is dropped, and the command says so at
its end, if there is anybody to say it to.
"""

from __future__ import annotations

import io
import sys
from typing import TextIO


class LossyFile(io.FileIO):
    """A descriptor that takes every byte, and drops those that its file refuses.

    Attributes:
        refusal: Why bytes were dropped; none if none were.
    """

    refusal: OSError | None = None

    def write(self, data: object) -> int:
        """Write, or drop."""
        if self.refusal is None:
            try:
                return super().write(data)  # type: ignore[arg-type]  # whatever the buffer gives
            except BlockingIOError:
                raise
            except OSError as error:
                self.refusal = error
        return memoryview(data).nbytes  # type: ignore[arg-type]


def tolerate_refusals() -> LossyFile:
    """Let standard output and error take every text, whatever their encoding and their file allow.

    Returns:
        The file behind standard output.
    """
    sys.stderr, _ = _tolerant(sys.stderr)
    sys.stdout, output = _tolerant(sys.stdout)
    return output


def _tolerant(stream: TextIO) -> tuple[TextIO, LossyFile]:
    file = LossyFile(stream.fileno(), "w", closefd=False)
    # A terminal of another encoding lacks some of our signs.
    text = io.TextIOWrapper(
        io.BufferedWriter(file), stream.encoding, errors="backslashreplace", line_buffering=stream.isatty()
    )
    return text, file
