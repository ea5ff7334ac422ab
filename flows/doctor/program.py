"""Small programs in processes of their own: a library that crashes or hangs must not take the examination along."""

from __future__ import annotations

import signal
import subprocess
import sys

PATIENCE_SECONDS = 60.0
"""The first import of torch on a busy machine has taken more than 20 s."""


class ProgramFailed(Exception):
    """A program did not do what it was to do; the message is a clause that says why."""


def run_program(source: str) -> str:
    """What a Python program prints.

    Raises:
        ProgramFailed: If it crashes, fails or takes too long.
    """
    # -P: what lies in the working directory is not a library.
    command = [sys.executable, "-P", "-W", "ignore", "-c", source]
    try:
        ended = subprocess.run(
            command, capture_output=True, text=True, errors="replace", timeout=PATIENCE_SECONDS, check=False
        )
    except subprocess.TimeoutExpired:
        raise ProgramFailed(f"did not end within {PATIENCE_SECONDS:.0f} s") from None
    if ended.returncode < 0:
        raise ProgramFailed(f"was ended by {signal.Signals(-ended.returncode).name}")
    if ended.returncode:
        last = [line for line in ended.stderr.splitlines() if line.strip()][-1:] or ["it gave no reason"]
        raise ProgramFailed(f"failed: {last[0].strip()}")
    return ended.stdout
