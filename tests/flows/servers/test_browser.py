"""A foreign page in a real browser, beside ``juicer ui`` and ``juicer serve``, learns and changes nothing."""

from __future__ import annotations

import json
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from benchmarks.page.chromium import CHROMIUM, Chromium

NAMES = "MAP evil.example 127.0.0.1, MAP rebound.example 127.0.0.1"
ATTACK = Path(__file__).with_name("attack.js")


@pytest.fixture
def browser(tmp_path):
    if CHROMIUM is None:
        pytest.skip("there is no Chromium on this machine")
    opened = Chromium(tmp_path / "profile", options=("--disable-popup-blocking", f"--host-resolver-rules={NAMES}"))
    yield opened
    opened.close()


@pytest.fixture
def elsewhere():
    """A web server of somebody else, which also notes what is sent to it."""
    noted = []

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            noted.append(self.path)
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(b"<!doctype html><title>evil</title><body>")

        def log_message(self, *arguments):
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://evil.example:{server.server_port}/"
    server.shutdown()


def snapshot(prefect, mlflow, deployment):
    """Everything that an attack would like to change."""
    filters = {"limit": 200}
    return {
        "deployment": prefect.read(f"/api/deployments/{deployment}")["pull_steps"] or [],
        "deployments": sorted(entry["id"] for entry in prefect.post("/api/deployments/filter", filters)),
        "flow runs": len(prefect.post("/api/flow_runs/filter", filters)),
        "flows": sorted(entry["name"] for entry in prefect.post("/api/flows/filter", filters)),
        "variables": prefect.post("/api/variables/filter", filters),
        "experiments": sorted(entry["name"] for entry in mlflow.read(mlflow.reads)["experiments"]),
    }


@pytest.mark.slow
def test_a_foreign_page_reads_and_writes_nothing(browser, elsewhere, servers, juicer, tmp_path):
    prefect, mlflow = servers["prefect"], servers["mlflow"]
    serving = juicer("serve", data=prefect.home)
    assert any(line.startswith("waiting for runs") for line in serving.stdout)
    found = prefect.post("/api/deployments/filter", {"limit": 50})
    deployment = next(entry["id"] for entry in found if entry["name"] == "loop")
    before = snapshot(prefect, mlflow, deployment)

    # The worst case: the user has given both passwords to this browser.
    browser.open(f"{prefect.url}/v2/login")
    browser.evaluate(f"localStorage.setItem('prefect-password', btoa({json.dumps(prefect.password)}))")
    told = json.dumps({"headers": {"Authorization": prefect.basic}})
    assert browser.evaluate(f"fetch('/api/admin/version', {told}).then(answer => answer.status)") == 200
    browser.open(mlflow.url.replace("//", f"//{mlflow.password}@") + mlflow.reads)
    browser.open(f"{mlflow.url}/")
    assert browser.evaluate(f"fetch({json.dumps(mlflow.reads)}).then(answer => answer.status)") == 200

    browser.open(elsewhere)
    names = ("127.0.0.1", "localhost", "rebound.example")
    targets = {
        "prefect": [f"http://{name}:{prefect.port}" for name in names],
        "mlflow": [f"http://{name}:{mlflow.port}" for name in names],
        "deployment": deployment,
        "password": prefect.basic,
        "sockets": [f"ws://{name}:{prefect.port}/api/events/{way}" for name in names for way in ("in", "out")],
        "token": prefect.password,
    }
    outcomes = browser.evaluate(ATTACK.read_text().replace("TARGETS", json.dumps(targets)))
    assert len(outcomes) > 60
    assert {name: outcome for name, outcome in outcomes.items() if outcome != "nothing"} == {}

    # To the browser, a name that has been made to point here is one with the server.
    for server in (prefect, mlflow):
        browser.open(f"http://rebound.example:{server.port}{server.page}")
        assert "does not answer to that host name" in browser.evaluate("document.body.innerText")
        assert browser.evaluate(f"fetch({json.dumps(server.reads)}).then(answer => answer.status)") == 403

    assert snapshot(prefect, mlflow, deployment) == before
    assert list(Path(mlflow.start).iterdir()) == []
