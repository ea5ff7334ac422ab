"""Servers end with whoever started them, say why they do not start, and are missed when they are gone."""

from __future__ import annotations

import os
import signal
import sqlite3
import subprocess
import sys
import time
import urllib.error
import urllib.request
from pathlib import Path

import pytest

from flows.running.flow_runs import FOLDER, held, mark_crashed
from flows.servers.environment import API_VARIABLE, DATABASE_VARIABLE, PASSWORD_VARIABLE
from flows.servers.process import cause_of
from flows.servers.temporary import TemporaryServer
from flows.servers.watch import ServerWatch
from juicer.errors import ConfigError, ServiceUnavailable
from tests.flows.servers.conftest import prefect

SMOKE = str(Path(__file__).parents[3] / "configs" / "smoke.yaml")
LOSS = "juicer: the Prefect server went away; what was made is in the store, the same command goes on from there"


def gone(process_ids):
    """Whether processes are gone, or soon are."""
    for _ in range(200):
        # A process whose parent is not told of its end yet is gone as well.
        states = [_state(number) for number in process_ids]
        if all(state in (None, "Z") for state in states):
            return True
        time.sleep(0.1)
    return False


def _state(number):
    try:
        return Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return None


def servers_of(process):
    """Process ids of the servers that a process has started."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            parent = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
            if parent == process.pid and b"flows.servers.program" in (folder / "cmdline").read_bytes():
                found.append(int(folder.name))
        except OSError:
            continue
    return found


def wait_for(process, *words):
    for line in process.stderr:
        if all(word in line for word in words):
            return
    pytest.fail("it ended before")


def is_refused(url):
    """Whether nobody listens any more, or soon nobody does."""
    for _ in range(100):
        try:
            urllib.request.urlopen(url, timeout=5).close()
        except ConnectionError:
            pass  # within the last moments of a process
        except urllib.error.URLError as error:
            if isinstance(error.reason, ConnectionRefusedError):
                return True
        time.sleep(0.1)
    return False


def test_servers_end_in_order_with_the_command_that_serves_the_pages(ui):
    process, said, data = ui
    children = servers_of(process)
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=60)
    assert process.returncode == 0
    assert gone(children)
    assert is_refused(said["prefect"])
    assert is_refused(said["mlflow"])
    assert not {".services.json", "servers.env"} & {path.name for path in data.iterdir()}


def test_servers_end_with_the_command_that_is_killed_and_are_started_again(ui, juicer):
    process, said, data = ui
    second = juicer("ui", data=data)
    _, err = second.communicate(timeout=60)
    assert second.returncode == 1
    assert err == f"juicer: the pages are already served: Prefect {said['prefect']}, MLflow {said['mlflow']}\n"
    children = servers_of(process)
    assert len(children) == 2
    process.kill()
    process.communicate(timeout=60)
    assert gone(children)
    assert is_refused(said["prefect"])
    assert is_refused(said["mlflow"])
    third = juicer("ui", "--prefect-port", said["prefect"].rpartition(":")[2], data=data)
    assert any("Ctrl-C ends both" in line for line in third.stdout)


PARENT = """
import sys, time
from flows.servers.temporary import TemporaryServer
server = TemporaryServer()
print(server._process._process.pid, flush=True)
if sys.argv[1] == "later":
    server.wait(120)
    print("ready", flush=True)
time.sleep(600)
"""


@pytest.mark.parametrize("moment", ["at once", "later"])
def test_temporary_server_ends_with_the_run_that_is_killed(tmp_path, moment):
    environment = {**os.environ, DATABASE_VARIABLE: f"sqlite+aiosqlite:///{tmp_path / 'prefect.db'}"}
    call = [sys.executable, "-c", PARENT, moment]
    parent = subprocess.Popen(call, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    number = int(parent.stdout.readline())
    if moment == "later":
        assert parent.stdout.readline() == "ready\n"
    parent.kill()
    parent.communicate(timeout=60)
    assert gone([number])


@pytest.fixture(scope="module")
def database(tmp_path_factory):
    """Address of a database that each test leaves to the next: a server takes long to make one."""
    return f"sqlite+aiosqlite:///{tmp_path_factory.mktemp('database') / 'prefect.db'}"


@pytest.fixture
def temporary(database, monkeypatch):
    monkeypatch.setenv(DATABASE_VARIABLE, database)
    server = TemporaryServer()
    yield server
    server.stop()


def answer(server, path, **headers):
    request = urllib.request.Request(f"{server.variables[API_VARIABLE]}{path}", headers=headers)
    try:
        with urllib.request.urlopen(request, timeout=30) as response:
            return response.status
    except urllib.error.HTTPError as error:
        return error.code


def test_temporary_server_answers_its_run_only(temporary):
    temporary.wait(120)
    assert answer(temporary, "/health") == 200
    assert answer(temporary, "/admin/version") == 401
    assert answer(temporary, "/health", Origin="https://evil.example") == 403
    assert answer(temporary, "/health", Host="evil.example") == 403
    assert temporary.variables[PASSWORD_VARIABLE] not in Path("/proc/self/cmdline").read_text()


def test_server_that_does_not_start_says_why(tmp_path, monkeypatch):
    # A folder where the database should be.
    monkeypatch.setenv(DATABASE_VARIABLE, f"sqlite+aiosqlite:///{tmp_path}")
    server = TemporaryServer()
    with pytest.raises(ServiceUnavailable, match=r"Prefect's server did not start: .*unable to open database file"):
        server.wait(120)


TRACEBACK = """\
ERROR:    Traceback (most recent call last):
  File "a.py", line 1, in f
    raise ValueError
ValueError: first

The above exception was the direct cause of the following exception:

Traceback (most recent call last):
  File "b.py", line 2, in g
sqlalchemy.exc.OperationalError: (sqlite3.OperationalError) unable to open database file
(Background on this error at: https://sqlalche.me/e/20/e3q8)

ERROR:    Application startup failed. Exiting.
"""


@pytest.mark.parametrize(
    ("said", "cause"),
    [
        (TRACEBACK, "sqlalchemy.exc.OperationalError: (sqlite3.OperationalError) unable to open database file"),
        ("warning: x\nPort 4200 is already in use.\n\n", "Port 4200 is already in use."),
        ("Fatal Python error: out of memory\n\nThread 0x1:\n  <no Python frame>", "Fatal Python error: out of memory"),
        ("Traceback (most recent call last):\n  File\nKeyboardInterrupt\n", "KeyboardInterrupt"),
        ("  \n", None),
        ("", None),
    ],
)
def test_cause_is_the_error_and_not_the_last_line(said, cause):
    assert cause_of(said) == cause


@pytest.mark.parametrize("name", ["prefect", "mlflow"])
def test_a_server_without_a_password_is_not_started(juicer, tmp_path, name):
    process = juicer("server", name, "--port", "65001", data=tmp_path)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 1
    assert err.startswith("juicer: a server without a password is not started; set ")


def test_unknown_server_is_refused(juicer, tmp_path):
    process = juicer("server", "prefct", data=tmp_path)
    assert "there is no server 'prefct'; did you mean 'prefect'?" in process.communicate(timeout=60)[1]


def test_flow_run_whose_process_was_killed_is_marked_crashed(temporary, tmp_path):
    temporary.wait(120)
    address = temporary.variables[API_VARIABLE]
    server = prefect(address.removesuffix("/api"), temporary.variables[PASSWORD_VARIABLE], tmp_path, tmp_path)
    flow = server.post("/api/flows/", {"name": "killed"})["id"]
    running = {"type": "RUNNING", "name": "Running"}
    runs = [server.post("/api/flow_runs/", {"flow_id": flow, "state": running})["id"] for _ in range(3)]
    killed, living, finished = runs
    task = {"flow_run_id": killed, "task_key": "t", "dynamic_key": "0", "state": running}
    task_run = server.post("/api/task_runs/", task)["id"]
    server.post(f"/api/flow_runs/{finished}/set_state", {"state": {"type": "COMPLETED"}, "force": True})
    with held(tmp_path, living):
        for run in (killed, finished):
            (tmp_path / FOLDER / run).touch()
        (tmp_path / FOLDER / "00000000-0000-0000-0000-000000000000").touch()
        (tmp_path / FOLDER / "nonsense").touch()
        mark_crashed(tmp_path, address, server.password)
        states = [server.read(f"/api/flow_runs/{run}")["state_type"] for run in runs]
        assert states == ["CRASHED", "RUNNING", "COMPLETED"]
        assert server.read(f"/api/task_runs/{task_run}")["state_type"] == "CRASHED"
        # What this server does not know may be another's.
        left = {path.name for path in (tmp_path / FOLDER).iterdir()}
        assert left == {living, "00000000-0000-0000-0000-000000000000", "nonsense"}
    assert not (tmp_path / FOLDER / living).exists()


def test_a_server_that_does_not_answer_keeps_nobody_from_starting(tmp_path):
    (tmp_path / FOLDER).mkdir()
    (tmp_path / FOLDER / "00000000-0000-0000-0000-000000000000").touch()
    mark_crashed(tmp_path, "http://127.0.0.1:9/api", None)
    assert list((tmp_path / FOLDER).iterdir())


def test_errors_that_have_nothing_to_do_with_the_server_are_passed_on():
    watch = ServerWatch(lambda: True, 60)
    with pytest.raises(ConfigError), watch.explaining():
        raise ConfigError("wrong")
    with pytest.raises(ZeroDivisionError), watch.explaining():
        raise ZeroDivisionError


@pytest.mark.slow
def test_many_runs_start_at_once_on_an_empty_data_folder(juicer, tmp_path):
    record = ("stage", "record", "-c", SMOKE, "--set", "record.demonstrations=1")
    runs = [juicer(*record, "--set", f"record.first={k}", data=tmp_path / "data") for k in range(6)]
    made = set()
    for process in runs:
        out, err = process.communicate(timeout=280)
        assert process.returncode == 0, err
        made.add(out.strip())
    assert len(made) == 6


@pytest.mark.slow
def test_run_ends_when_its_own_server_is_killed(juicer, tmp_path):
    data = tmp_path / "data"
    process = juicer("run", SMOKE, data=data)
    wait_for(process, "✓", "record")
    (server,) = servers_of(process)
    os.kill(server, signal.SIGKILL)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 1
    assert err.rstrip().endswith(LOSS)
    assert "Traceback" not in err
    assert list((data / "logs").iterdir())
    (flow_run,) = (data / FOLDER).iterdir()
    # The next to start says what became of it.
    again = juicer("stage", "record", "-c", SMOKE, data=data)
    again.communicate(timeout=120)
    assert again.returncode == 0
    assert not flow_run.exists()
    with sqlite3.connect(data / "prefect.db") as database:
        states = dict(database.execute("select replace(id, '-', ''), state_name from flow_run"))
    assert states[flow_run.name.replace("-", "")] == "Crashed"


@pytest.mark.slow
def test_run_ends_when_the_server_of_the_pages_goes_away(ui, juicer):
    pages, _, data = ui
    process = juicer("run", SMOKE, data=data)
    wait_for(process, "✓", "record")
    pages.kill()
    _, err = process.communicate(timeout=60)
    assert process.returncode == 1
    assert err.rstrip().endswith(LOSS)
    assert list((data / "logs").iterdir())
