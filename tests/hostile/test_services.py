"""Whatever state Prefect and MLflow are in, a run ends in order: with its work done, or with a sentence."""

from __future__ import annotations

import os
import shutil
import socket
import sqlite3
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PATIENCE_SECONDS = 200
"""Far more than any of these runs may take; one that hangs is ended."""

OVERRIDES = (
    "conditions=[bc]",
    "record.demonstrations=2",
    "policies.diffusion.training={steps: 4, warmup_steps: 1, validation_fraction: 0.5, windows: {back_padding: 15}}",
    "evaluate={episodes: 1, max_steps: 10}",
)
CLOSED = "http://127.0.0.1:9"

pytestmark = [pytest.mark.slow, pytest.mark.timeout(PATIENCE_SECONDS + 60)]


def juicer(data: Path, *overrides: str, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run the smallest study there is."""
    settings = [part for text in (*OVERRIDES, *overrides) for part in ("--set", text)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "JUICER_DATA": str(data), **variables}
    command = [sys.executable, "-m", "juicer", "run", "smoke", *settings]
    return subprocess.run(
        command, cwd=data, env=environment, capture_output=True, text=True, timeout=PATIENCE_SECONDS, check=False
    )


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data folder that holds all but a last evaluation."""
    data = tmp_path_factory.mktemp("made")
    done = juicer(data, JUICER_TRACKING_URI="none")
    assert done.returncode == 0, done.stderr
    return data


@pytest.fixture
def data(made: Path, tmp_path: Path) -> Path:
    """A copy of it, without databases."""
    copy = tmp_path / "data"
    shutil.copytree(made, copy, ignore=shutil.ignore_patterns("*.db*"))
    return copy


@pytest.fixture
def surroundings() -> Iterator[ExitStack]:
    """Holds what a state consists of."""
    with ExitStack() as stack:
        yield stack


@contextmanager
def mute_server() -> Iterator[str]:
    """A server that takes connections and never says a word."""
    with closing(socket.create_server(("127.0.0.1", 0), backlog=64)) as listener:
        yield f"http://127.0.0.1:{listener.getsockname()[1]}"


@contextmanager
def odd_server(status: int, body: bytes, kind: str = "text/html") -> Iterator[str]:
    """A server that always gives one answer."""

    class Handler(BaseHTTPRequestHandler):
        def answer(self) -> None:
            self.rfile.read(int(self.headers.get("content-length", 0)))
            self.send_response(status)
            self.send_header("content-type", kind)
            self.send_header("content-length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        do_GET = do_POST = do_PUT = do_PATCH = do_DELETE = do_HEAD = answer  # noqa: N815 (the names that are looked for)

        def log_message(self, *_: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()
        server.server_close()


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """A database that another process does not let go of."""
    with closing(sqlite3.connect(path, isolation_level=None)) as connection:
        connection.execute("create table if not exists other (number integer)")
        connection.execute("begin exclusive")
        yield


def write(path: Path, content: bytes) -> None:
    path.write_bytes(content)


State = Callable[[Path, ExitStack], dict[str, str]]


def at(server: Callable[[], contextmanager], variable: str, path: str = "") -> State:  # type: ignore[valid-type]
    return lambda data, stack: {variable: stack.enter_context(server()) + path}


def with_file(change: Callable[[Path], object]) -> State:
    def state(data: Path, stack: ExitStack) -> dict[str, str]:
        change(data)
        return {}

    return state


MLFLOW: dict[str, State] = {
    "nobody there": lambda data, stack: {"JUICER_TRACKING_URI": CLOSED},
    "mute": at(mute_server, "JUICER_TRACKING_URI"),
    "failing": at(lambda: odd_server(500, b"<h1>Oops</h1>"), "JUICER_TRACKING_URI"),
    "another program": at(lambda: odd_server(200, b"<h1>Welcome</h1>"), "JUICER_TRACKING_URI"),
    "asking for a password": at(lambda: odd_server(401, b"who are you?"), "JUICER_TRACKING_URI"),
    "database is garbage": with_file(lambda data: write(data / "mlflow.db", b"garbage" * 1000)),
    "database is a folder": with_file(lambda data: (data / "mlflow.db").mkdir()),
    "database is empty": with_file(lambda data: write(data / "mlflow.db", b"")),
    "database is locked": lambda data, stack: stack.enter_context(locked(data / "mlflow.db")) or {},
}

PREFECT: dict[str, State] = {
    "nobody there": lambda data, stack: {"PREFECT_API_URL": f"{CLOSED}/api"},
    "no address": lambda data, stack: {"PREFECT_API_URL": "prefect.example.org"},
    "mute": at(mute_server, "PREFECT_API_URL", "/api"),
    "failing": at(lambda: odd_server(500, b"<h1>Oops</h1>"), "PREFECT_API_URL", "/api"),
    "another program": at(lambda: odd_server(200, b"<h1>Welcome</h1>"), "PREFECT_API_URL", "/api"),
    "asking for a password": at(lambda: odd_server(401, b"who are you?"), "PREFECT_API_URL", "/api"),
    "database is garbage": with_file(lambda data: write(data / "prefect.db", b"garbage" * 1000)),
    "database is a folder": with_file(lambda data: (data / "prefect.db").mkdir()),
}


@pytest.mark.parametrize("state", MLFLOW.values(), ids=MLFLOW)
def test_a_run_does_its_work_whatever_mlflow_is_like(state: State, data: Path, surroundings: ExitStack):
    done = juicer(data, "evaluate.first=7", **state(data, surroundings))
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    assert len(list((data / "evaluation").iterdir())) == 2
    assert "BC" in done.stdout


@pytest.mark.parametrize("state", PREFECT.values(), ids=PREFECT)
def test_a_run_says_in_a_sentence_what_prefect_is_like(state: State, data: Path, surroundings: ExitStack):
    done = juicer(data, "evaluate.first=7", JUICER_TRACKING_URI="none", **state(data, surroundings))
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    *_, last = done.stderr.strip().splitlines()
    assert last.startswith("juicer: ")
    assert len(last) < 700
    assert len(list((data / "evaluation").iterdir())) == 1
