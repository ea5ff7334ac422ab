"""The pages as they are really served, by a process of their own."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest


@dataclass
class Server:
    address: str
    token: str
    process: subprocess.Popen[str]

    @property
    def teleop(self) -> str:
        return f"{self.address}/teleop?token={self.token}&numbers=1"

    def kill(self) -> None:
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()


@contextmanager
def serving(data: Path) -> Iterator[Server]:
    process = subprocess.Popen(
        [sys.executable, "-m", "juicer", "pages", "--json"],
        stdout=subprocess.PIPE, text=True, env=os.environ | {"JUICER_DATA": str(data)},
    )  # fmt: skip
    try:
        told = ""
        while not told.endswith("}\n"):
            line = process.stdout.readline()
            assert line, "the server did not start"
            told += line
        content = json.loads(told)
        yield Server(content["pages"], content["token"], process)
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
            process.wait(20)


@pytest.fixture
def serve():
    return serving
