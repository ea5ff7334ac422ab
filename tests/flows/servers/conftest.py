"""Real servers, started as users start them, and requests as a browser may send them."""

from __future__ import annotations

import base64
import http.client
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

import pytest
import yaml

ROOT = Path(__file__).parents[3]


@dataclass(frozen=True)
class Running:
    """A server under test.

    Attributes:
        url: Its base address.
        password: What it asks for, as ``user:password``.
        reads: Path that reads what only those with the password may read.
        writes: Path that takes a POST.
        content: What is posted there.
        page: Path of its page.
        home: Folder that everything it keeps must be in.
        start: Folder in which it was started.
    """

    url: str
    password: str
    reads: str
    writes: str
    content: Mapping[str, object]
    page: str
    home: Path
    start: Path

    @property
    def port(self):
        return urlsplit(self.url).port

    @property
    def basic(self):
        return "Basic " + base64.b64encode(self.password.encode()).decode()

    def ask(self, path, method="GET", headers=(), body=None, host=None, password=None):
        """Status, headers and text of an answer; every header is ours to choose, Host included."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=30)
        try:
            connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
            sent = {"Host": f"127.0.0.1:{self.port}" if host is None else host, **dict(headers)}
            if password:
                sent["Authorization"] = password
            if body is not None:
                sent["Content-Length"] = str(len(body))
            for name, value in sent.items():
                connection.putheader(name, value)
            connection.endheaders(body)
            answer = connection.getresponse()
            return answer.status, {name.lower(): value for name, value in answer.getheaders()}, answer.read().decode()
        finally:
            connection.close()

    def read(self, path):
        """What whoever has the password reads."""
        status, _, text = self.ask(path, password=self.basic)
        assert status == 200, text
        return json.loads(text)

    def post(self, path, content):
        """What is answered to whoever has the password."""
        json_type = {"Content-Type": "application/json"}
        for _ in range(5):
            status, _, text = self.ask(path, "POST", json_type, json.dumps(content).encode(), password=self.basic)
            if status != 503:  # the database is locked at the moment
                break
            time.sleep(0.5)
        assert status < 300, text
        return json.loads(text)


def prefect(url, password, home, start):
    """Prefect's server."""
    filters = "/api/deployments/filter"
    return Running(url, password, "/api/admin/version", filters, {}, "/v2/", home, start)


def mlflow(url, password, home, start):
    """MLflow's server."""
    experiments = "/ajax-api/2.0/mlflow/experiments"
    content = {"name": "written by a foreign page"}
    return Running(
        url, password, f"{experiments}/search?max_results=9", f"{experiments}/create", content, "/", home, start
    )


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def call_juicer(*arguments, data, cwd, **variables):
    """The command as a process of its own."""
    environment = {
        **{name: value for name, value in os.environ.items() if not name.startswith(("PREFECT_", "MLFLOW_"))},
        "PYTHONPATH": str(ROOT),
        "JUICER_DATA": str(data),
        "OMP_NUM_THREADS": "1",
        **variables,
    }
    return subprocess.Popen(
        [sys.executable, "-m", "flows.command.cli", *arguments],
        env=environment,
        cwd=cwd,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def end(process):
    """Interrupt a command and wait for it."""
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGINT)
    return process.communicate(timeout=60)


def start_ui(data, cwd):
    """``juicer ui`` on free ports: its process and what it says."""
    data.mkdir(parents=True, exist_ok=True)
    ports = ("--prefect-port", str(free_port()), "--mlflow-port", str(free_port()))
    process = call_juicer("ui", "--json", *ports, data=data, cwd=cwd)
    said = ""
    for line in process.stdout:
        said += line
        if line == "}\n":
            return process, json.loads(said)
    return pytest.fail(process.communicate()[1])


def of_compose(name, folder):
    """A server's command and variables from the Compose file, without its containers: SQLite and a folder."""
    services = yaml.safe_load((ROOT / "docker-compose.yml").read_text())["services"]
    port = free_port()
    here = {"4200": str(port), "5000": str(port), "0.0.0.0": "127.0.0.1"}
    command = [here.get(word, word) for word in services[name]["command"]]
    replaced = {
        "PREFECT_SERVER_DATABASE_CONNECTION_URL": f"sqlite+aiosqlite:///{folder / 'prefect.db'}",
        "PREFECT_SERVER_UI_STATIC_DIRECTORY": str(folder / "pages"),
        "PREFECT_SERVER_API_AUTH_STRING": "juicer:changeme4",
        "MLFLOW_BACKEND_STORE_URI": f"sqlite:///{folder / 'mlflow.db'}",
        "MLFLOW_ARTIFACTS_DESTINATION": str(folder / "bucket"),
        "MLFLOW_TRACKING_PASSWORD": "changeme5",
        "JUICER_ALLOWED_HOSTS": f"{name}:{port},https://{name}.example.org",
    }
    wanted = {key: value for key, value in services[name]["environment"].items() if not key.startswith("AWS_")}
    return port, command, {key: replaced.get(key, value) for key, value in wanted.items()}


@pytest.fixture(scope="session")
def servers(tmp_path_factory):
    """Both servers of ``juicer ui`` and both of the Compose file, by name."""
    base = tmp_path_factory.mktemp("servers")
    processes, found = [], {}
    try:
        for name, kind, user in (("prefect", prefect, "juicer:changeme4"), ("mlflow", mlflow, "juicer:changeme5")):
            home, start = base / f"team-{name}", base / f"start-{name}"
            home.mkdir()
            start.mkdir()
            port, command, variables = of_compose(name, home)
            assert command[0] == "juicer"
            processes.append(call_juicer(*command[1:], data=home, cwd=start, **variables))
            found[f"team {name}"] = kind(f"http://127.0.0.1:{port}", user, home, start)
        start = base / "start-ui"
        start.mkdir()
        process, said = start_ui(base / "data", start)
        processes.append(process)
        password = f"juicer:{Path(said['password_file']).read_text().strip()}"
        found["prefect"] = prefect(said["prefect"], password, base / "data", start)
        found["mlflow"] = mlflow(said["mlflow"], password, base / "data", start)
        for name in ("team prefect", "team mlflow"):
            wait_for(found[name])
        yield found
    finally:
        for process in processes:
            end(process)


def wait_for(server):
    """Wait until a server answers."""
    path = "/api/health" if "prefect" in str(server.home) else "/health"
    for _ in range(600):
        try:
            if server.ask(path)[0] == 200:
                return
        except OSError:
            time.sleep(0.2)
    pytest.fail(f"{server.url} does not answer")


@pytest.fixture(params=["prefect", "mlflow", "team prefect", "team mlflow"])
def server(request, servers):
    """Each of the servers."""
    return servers[request.param]


@pytest.fixture
def juicer(tmp_path):
    """Starts commands, and ends those that still run: ``juicer("ls", data=folder)``."""
    started = []

    def call(*arguments, data, cwd=tmp_path, **variables):
        started.append(call_juicer(*arguments, data=data, cwd=cwd, **variables))
        return started[-1]

    yield call
    for process in started:
        end(process)


@pytest.fixture(scope="session")
def served(tmp_path_factory):
    """A data folder that each test leaves to the next: servers take long to make their databases."""
    return tmp_path_factory.mktemp("served") / "data"


@pytest.fixture
def ui(served, tmp_path):
    """``juicer ui``: its process, what it says, the data folder."""
    process, said = start_ui(served, tmp_path)
    yield process, said, served
    end(process)
