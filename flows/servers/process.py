"""A server in a process of its own, which ends with the one that started it, whatever ends that."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import BinaryIO

from flows.servers.addresses import is_answering, port_of
from juicer.errors import ServiceUnavailable
from juicer.text import printable

POLL_SECONDS = 0.2
GRACE_SECONDS = 10.0
_MOST_WORDS = 200_000
"""Bytes at the end of what a server said that are searched for a cause."""


class ServerProcess:
    """One of the servers that ``flows.servers.program`` knows.

    Attributes:
        name: ``prefect`` or ``mlflow``.
        url: Its base address.
        health: Address that answers once it serves.
    """

    def __init__(
        self,
        name: str,
        health: str,
        listener: socket.socket,
        variables: Mapping[str, str],
        log: Path | None = None,
    ) -> None:
        """Start it.

        Args:
            name: ``prefect`` or ``mlflow``.
            health: Path that answers once it serves.
            listener: Where it serves; the process is handed the socket.
            variables: Added to the environment.
            log: Where its words go; they are kept until it has started if there is no such place.
        """
        self.name = name
        self.url = f"http://127.0.0.1:{port_of(listener)}"
        self.health = f"{self.url}{health}"
        self._log = log
        self._words: BinaryIO = log.open("w+b") if log else tempfile.TemporaryFile()  # noqa: SIM115 (open as long as the process)
        self._process = subprocess.Popen(
            [sys.executable, "-m", "flows.servers.program", name, str(listener.fileno())],
            env={**os.environ, **variables},
            pass_fds=[listener.fileno()],
            stdin=subprocess.PIPE,
            stdout=self._words,
            stderr=self._words,
            # An interrupt from the keyboard must not reach it: it is ended in order.
            start_new_session=True,
        )

    @property
    def has_ended(self) -> bool:
        """Whether the process is gone."""
        return self._process.poll() is not None

    def stop(self) -> None:
        """End it, with whatever it has started."""
        for number in (signal.SIGTERM, signal.SIGKILL):
            try:
                os.killpg(self._process.pid, number)
                self._process.wait(GRACE_SECONDS)
            except ProcessLookupError:
                break
            except subprocess.TimeoutExpired:
                continue

    def cause(self) -> str:
        """Why it ended."""
        size = self._words.seek(0, os.SEEK_END)
        self._words.seek(max(0, size - _MOST_WORDS))
        text = self._words.read().decode(errors="replace")
        status = self._process.poll()
        if found := cause_of(text):
            cause = printable(found, 500)
        elif status is not None and status < 0:
            cause = f"it was ended by {signal.Signals(-status).name}"
        else:
            cause = f"it ended with status {status} and without a word"
        return f"{cause}; its log is '{self._log}'" if self._log else cause


def await_health(servers: Iterable[ServerProcess], seconds: float) -> None:
    """Wait until all of them answer.

    Raises:
        ServiceUnavailable: If one does not, or ends.
    """
    deadline = time.monotonic() + seconds
    for server in servers:
        while not is_answering(server.health):
            if server.has_ended:
                raise ServiceUnavailable(f"{title(server.name)}'s server did not start: {server.cause()}")
            if time.monotonic() > deadline:
                raise ServiceUnavailable(
                    f"{title(server.name)}'s server did not answer within {seconds:.0f} s; "
                    "set JUICER_STARTUP_SECONDS to wait longer"
                )
            time.sleep(POLL_SECONDS)


def title(name: str) -> str:
    """A server's name as its makers write it."""
    return {"prefect": "Prefect", "mlflow": "MLflow"}[name]


def cause_of(text: str) -> str | None:
    """The line that says why a process ended, of all that it said.

    Below a traceback this is the error itself, not what its library adds to it.
    """
    lines = [line.rstrip() for line in text.splitlines()]
    fatal = [line for line in lines if line.startswith("Fatal Python error")]
    if fatal:
        return fatal[-1]
    starts = [number for number, line in enumerate(lines) if "Traceback (most recent call last)" in line]
    if starts:
        for line in lines[starts[-1] + 1 :]:
            if re.match(r"[A-Za-z_][\w.]*(: |$)", line):
                return line
    said = [line for line in lines if line.strip()]
    return said[-1].strip() if said else None
