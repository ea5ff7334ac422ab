"""Real servers, of ``juicer ui`` and of the Compose file, against what a browser may send them."""

from __future__ import annotations

import asyncio
import json
import os
import re
import subprocess
import sys

import pytest
import websockets

from flows.servers.environment import API_VARIABLE, PASSWORD_VARIABLE

METHODS = ["GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"]
JSON = {"Content-Type": "application/json"}
CONTENT_TYPES = [{}, JSON, {"Content-Type": "text/plain"}, {"Content-Type": "application/x-www-form-urlencoded"}]
PREFLIGHT = {"Access-Control-Request-Method": "PATCH", "Access-Control-Request-Headers": "content-type,authorization"}


def foreign(server):
    """What a browser adds to requests of a page that is not the server's own, the most telling last."""
    port = server.port
    return [
        {"Origin": "https://evil.example"},
        {"Origin": "null"},
        {"Origin": f"http://127.0.0.1:{port + 1}"},
        {"Origin": f"http://evil.example:{port}"},
        {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "no-cors", "Sec-Fetch-Dest": "image"},
        {"Sec-Fetch-Site": "same-site", "Sec-Fetch-Mode": "cors", "Sec-Fetch-Dest": "empty"},
        {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "navigate", "Sec-Fetch-Dest": "iframe"},
        {"Origin": f"http://localhost:{port}", "Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "cors"},
    ]


def test_programs_with_the_password_are_served(server):
    assert server.read(server.reads)


@pytest.mark.parametrize("method", METHODS)
def test_foreign_pages_are_refused_even_if_they_bring_the_password(server, method):
    for told in foreign(server):
        for kind in CONTENT_TYPES:
            for path in (server.reads, server.writes, server.page):
                body = None if method in ("GET", "HEAD") else json.dumps(server.content).encode()
                status, headers, _ = server.ask(path, method, {**told, **kind}, body, password=server.basic)
                assert status == 403, (told, kind, path)
                assert not [name for name in headers if name.startswith("access-control-")]


def test_preflights_of_foreign_pages_are_refused(server):
    for told in foreign(server):
        status, headers, _ = server.ask(server.writes, "OPTIONS", {**told, **PREFLIGHT})
        assert status == 403
        assert not [name for name in headers if name.startswith("access-control-")]


@pytest.mark.parametrize("name", ["evil.example", "localhost.evil.example", "127.0.0.2", "169.254.169.254", ""])
def test_a_name_that_is_made_to_point_here_is_refused(server, name):
    for host in (f"{name}:{server.port}", name):
        # To the browser, this page and this server are one.
        told = {"Origin": f"http://{host}", "Sec-Fetch-Site": "same-origin"}
        for path in (server.reads, server.page, "/health", "/api/health", "/version"):
            assert server.ask(path, host=host, password=server.basic)[0] == 403
            assert server.ask(path, "POST", {**told, **JSON}, b"{}", host=host, password=server.basic)[0] == 403


def test_without_the_right_password_nothing_is_read_or_written(server):
    for password in (None, "Basic " + "x" * 20, "Bearer x", "Basic anVpY2VyOg==", "Basic Og=="):
        assert server.ask(server.reads, password=password)[0] == 401
        for kind in CONTENT_TYPES:
            body = json.dumps(server.content).encode()
            assert server.ask(server.writes, "POST", kind, body, password=password)[0] == 401


def test_nothing_was_written(servers):
    for name in ("mlflow", "team mlflow"):
        found = servers[name].read(servers[name].reads)
        assert [experiment["name"] for experiment in found["experiments"]] == ["Default"]


def test_own_pages_are_served_and_may_not_be_framed(server):
    for host in ("127.0.0.1", "localhost", "[::1]"):
        own = f"{host}:{server.port}"
        told = {"Origin": f"http://{own}", "Sec-Fetch-Site": "same-origin", "Sec-Fetch-Mode": "cors"}
        status, headers, _ = server.ask(server.reads, headers=told, host=own, password=server.basic)
        assert status == 200
        assert headers["x-frame-options"] == "SAMEORIGIN"
        assert "frame-ancestors 'self'" in headers["content-security-policy"]
        assert not [name for name in headers if name.startswith("access-control-")]
        link = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "navigate", "Sec-Fetch-Dest": "document"}
        assert server.ask(server.page, headers=link, host=own, password=server.basic)[0] == 200


def test_whether_it_lives_is_told_without_a_password(server):
    assert server.ask("/health" if "mlflow" in server.reads else "/api/health")[0] == 200


@pytest.mark.parametrize("name", ["team prefect", "team mlflow"])
def test_a_name_that_is_added_is_answered(servers, name):
    server = servers[name]
    public = f"{name.split()[1]}.example.org"
    told = {"Origin": f"https://{public}", "Sec-Fetch-Site": "same-origin", **JSON}
    assert server.ask(server.reads, headers=told, host=public, password=server.basic)[0] == 200
    # A proxy may call it by the name that only it knows.
    inside = f"{name.split()[1]}:{server.port}"
    assert server.ask(server.reads, headers=told, host=inside, password=server.basic)[0] == 200
    assert server.ask(server.reads, headers={"Origin": "https://evil.example"}, host=public)[0] == 403


def test_prefect_asks_for_the_password_on_every_path_of_its_interface(servers):
    server = servers["prefect"]
    paths = json.loads(server.ask("/openapi.json", password=server.basic)[2])["paths"]
    assert len(paths) > 100
    open_to_all = set()
    for path, methods in paths.items():
        filled = "/api" + re.sub(r"\{[^}]+\}", "00000000-0000-0000-0000-000000000000", path).removeprefix("/api")
        for method in methods:
            status, _, _ = server.ask(filled, method.upper(), JSON, b"{}")
            if status != 401:
                open_to_all.add((method, filled, status))
    assert {(method, path) for method, path, _ in open_to_all} <= {("get", "/api/health"), ("get", "/api/ready")}


def test_mlflow_takes_no_files_into_the_folder_where_it_was_started(servers):
    server = servers["mlflow"]
    for base in ("/api/2.0/mlflow-artifacts/artifacts", "/ajax-api/2.0/mlflow-artifacts/artifacts"):
        for path in ("x.txt", "1/x.txt", "../x.txt"):
            assert server.ask(f"{base}/{path}", "PUT", {}, b"x", password=server.basic)[0] >= 400
    for server in servers.values():
        assert list(server.start.iterdir()) == []


def test_mlflows_files_are_kept_where_they_belong(servers):
    for name, root in (("mlflow", "mlflow-files"), ("team mlflow", "mlflow-artifacts:/")):
        (experiment,) = servers[name].read(servers[name].reads)["experiments"]
        assert root in experiment["artifact_location"]


def socket_paths():
    """Every websocket of Prefect's server, those of later versions included."""
    from prefect.server.api.server import API_ROUTERS
    from starlette.routing import WebSocketRoute

    routes = [route for router in API_ROUTERS for route in router.routes if isinstance(route, WebSocketRoute)]
    return sorted("/api" + re.sub(r"\{[^}]+\}", "pool", route.path) for route in routes)


def open_socket(server, path, headers, token, host=None):
    """What becomes of a websocket: a status, or the first answer, or the code of its end."""

    async def connect():
        address = f"ws://127.0.0.1:{server.port}{path}"
        try:
            async with websockets.connect(
                address if host is None else address.replace("127.0.0.1", host),
                additional_headers=headers,
                subprotocols=["prefect"],
                host="127.0.0.1",
                port=server.port,
                proxy=None,
            ) as socket:
                await socket.send(json.dumps({"type": "auth", "token": token}))
                return json.loads(await asyncio.wait_for(socket.recv(), 10))["type"]
        except websockets.InvalidStatus as refusal:
            return refusal.response.status_code
        except websockets.ConnectionClosed as closed:
            return closed.rcvd.code

    return asyncio.run(connect())


@pytest.mark.parametrize("name", ["prefect", "team prefect"])
def test_websockets_ask_for_the_password_and_refuse_foreign_pages(servers, name):
    server = servers[name]
    paths = socket_paths()
    assert {"/api/events/in", "/api/events/out", "/api/logs/out"} <= set(paths)
    for path in paths:
        assert open_socket(server, path, {}, server.password) == "auth_success"
        assert open_socket(server, path, {}, "juicer:wrong") == 1008
        assert open_socket(server, path, {}, None) == 1008
        for told in foreign(server):
            assert open_socket(server, path, told, server.password) == 403
        assert open_socket(server, path, {}, server.password, host="evil.example") == 403


def test_websockets_to_mlflow_are_refused(servers):
    assert open_socket(servers["mlflow"], "/", {"Origin": "https://evil.example"}, "") == 403


SHELL = """
set -eu
. "$1"
"$2" -m prefect version > /dev/null
"$2" -m prefect work-pool create --type process from-a-shell > /dev/null
"$2" -m mlflow experiments create --experiment-name from-a-shell > /dev/null
"""


def test_commands_of_both_work_in_a_shell_that_has_read_the_file(servers, tmp_path):
    server, records = servers["prefect"], servers["mlflow"]
    path = server.home / "servers.env"
    assert path.stat().st_mode & 0o777 == 0o600
    environment = {
        name: value for name, value in os.environ.items() if name not in (API_VARIABLE, PASSWORD_VARIABLE)
    } | {"HOME": str(tmp_path)}
    call = ["sh", "-c", SHELL, "sh", str(path), sys.executable]
    done = subprocess.run(call, env=environment, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert server.read("/api/work_pools/from-a-shell")["type"] == "process"
    assert "from-a-shell" in json.dumps(records.read(records.reads))
