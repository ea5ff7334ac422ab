"""``juicer pages`` serves the pages to their owner, on this machine only, and ends at Ctrl-C."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys

import httpx
import pytest
from starlette.testclient import TestClient

from flows.command.pages import pages, token_of
from flows.running.services import find_pages
from flows.running.settings import Settings
from flows.servers.secret import credentials_of

COMMAND = [sys.executable, "-m", "juicer", "pages", "--json"]


@pytest.fixture
def environment(tmp_path):
    return {**os.environ, "JUICER_DATA": str(tmp_path)}


def test_pages_are_served_announced_and_ended(tmp_path, environment):
    served = subprocess.Popen(COMMAND, env=environment, stdout=subprocess.PIPE, text=True)
    try:
        told = json.loads("".join(iter(served.stdout.readline, "}\n")) + "}")
        assert find_pages(tmp_path) == told["pages"]
        with httpx.Client(base_url=told["pages"], follow_redirects=True, trust_env=False) as client:
            assert client.get("/").status_code == 401
            answer = client.get("/", params={"token": told["token"]})
            assert answer.status_code == 200
            assert "token" not in str(answer.url)
        again = subprocess.run(COMMAND, env=environment, capture_output=True, text=True, check=False)
        assert again.returncode == 1
        assert (
            json.loads(again.stdout)["error"] == f"the pages are already served: {told['pages']}/?token={told['token']}"
        )
        served.send_signal(signal.SIGINT)
        assert served.wait(60) == 0
        assert find_pages(tmp_path) == ""
    finally:
        served.kill()
        served.wait()


def test_token_stays_the_same_and_does_not_tell_the_password(tmp_path):
    settings = Settings(data=tmp_path)
    token = token_of(settings)
    assert token == token_of(settings)
    assert token not in credentials_of(tmp_path).password


@pytest.mark.parametrize(
    "headers",
    [
        {"host": "evil.example:8000"},
        {"origin": "http://evil.example"},
        {"origin": "http://127.0.0.1:8001"},
        {"sec-fetch-site": "cross-site"},
    ],
)
def test_other_web_pages_are_refused_even_with_the_token(tmp_path, headers):
    settings = Settings(data=tmp_path)
    client = TestClient(pages(settings, 8000, token_of(settings)), base_url="http://127.0.0.1:8000")
    client.get("/", params={"token": token_of(settings)})
    assert client.get("/").status_code == 200
    assert client.get("/", headers=headers).status_code == 403


def test_page_carries_both_content_policies(tmp_path):
    settings = Settings(data=tmp_path)
    client = TestClient(pages(settings, 8000, token_of(settings)), base_url="http://127.0.0.1:8000")
    policies = client.get("/", params={"token": token_of(settings)}).headers.get_list("content-security-policy")
    assert any("default-src 'none'" in policy for policy in policies)
