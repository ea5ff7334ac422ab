"""The pages as they are really served, by a process of their own."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self


@dataclass(frozen=True)
class Server:
    """Pages that are served.

    Attributes:
        address: As it is told.
        token: Opens it.
        process: Serves it.
    """

    address: str
    token: str
    process: subprocess.Popen[str]

    @property
    def port(self) -> int:
        """Where it listens."""
        return int(self.address.rpartition(":")[2])

    @property
    def teleop(self) -> str:
        """Where one drives, with the numbers that hands look at."""
        return f"{self.address}/teleop?token={self.token}&numbers=1"

    def annotate(self, episodes: str) -> str:
        """Where an artifact of episodes is annotated."""
        return f"{self.address}/annotate/{episodes}?token={self.token}"

    def through(self, port: int) -> Self:
        """The same, as seen through another port of this machine."""
        return replace(self, address=self.address.replace(f":{self.port}", f":{port}"))

    def kill(self) -> None:
        """End it as the system does when memory runs out."""
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()


@contextmanager
def serving(data: Path, **surroundings: str) -> Iterator[Server]:
    """The pages of a data folder, until the end of the block.

    Args:
        data: The folder.
        surroundings: Further variables of the server's environment.
    """
    process = subprocess.Popen(
        [sys.executable, "-m", "juicer", "pages", "--json"],
        stdout=subprocess.PIPE, text=True, env=os.environ | surroundings | {"JUICER_DATA": str(data)},
    )  # fmt: skip
    try:
        told = ""
        while not told.endswith("}\n"):
            assert process.stdout is not None
            line = process.stdout.readline()
            assert line, "the server did not start"
            told += line
        content = json.loads(told)
        yield Server(content["pages"], content["token"], process)
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
            process.wait(20)
