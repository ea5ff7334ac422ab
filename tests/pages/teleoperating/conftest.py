"""The pages as they are really served, by a process of their own; and their socket, without a browser."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest
from starlette.testclient import TestClient

from juicer.pages.application import create_application
from juicer.pages.workplace import Workplace
from tests.pages.teleoperating.talking import Page


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


@pytest.fixture
def application(store, tmp_path):
    return create_application(Workplace(store, tmp_path))


@pytest.fixture
def client(application) -> Iterator[TestClient]:
    with TestClient(application) as client:
        yield client


@pytest.fixture
def connect(client) -> Iterator[Callable[[], Page]]:
    with ExitStack() as sockets:

        def open_page() -> Page:
            return Page(sockets.enter_context(client.websocket_connect("/teleop/live")))

        yield open_page


@pytest.fixture
def page(connect) -> Page:
    return connect()
