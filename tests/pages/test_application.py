"""Pages answer whoever knows the token, in sentences, and let a browser do nothing that they do not need."""

from __future__ import annotations

import pytest
from starlette.testclient import TestClient

from juicer.artifacts.store import ArtifactStore
from juicer.pages.access import Access
from juicer.pages.application import create_application
from juicer.pages.limits import MOST_BODY_BYTES
from juicer.pages.workplace import Workplace

HTML = {"accept": "text/html"}
TOKEN = "f" * 32


@pytest.fixture
def application(tmp_path):
    application = create_application(Workplace(ArtifactStore(tmp_path), tmp_path))

    @application.post("/length")
    async def length(request: dict[str, str]):
        return len(request)

    return application


@pytest.fixture
def client(application):
    return TestClient(application)


@pytest.fixture
def stranger(application):
    return TestClient(Access(application, TOKEN), base_url="http://127.0.0.1")


def test_page_without_the_token_is_refused_with_a_sentence(stranger):
    answer = stranger.get("/")
    assert answer.status_code == 401
    assert "juicer pages" in answer.text


@pytest.mark.parametrize("wrong", ["", "f", "ä" * 32, "f" * 33, TOKEN.upper()])
def test_page_with_another_token_is_refused(stranger, wrong):
    assert stranger.get("/", params={"token": wrong}).status_code == 401


def test_token_leaves_the_address_and_is_remembered(stranger):
    answer = stranger.get("/", params={"kind": "episodes", "token": TOKEN}, follow_redirects=False)
    assert (answer.status_code, answer.headers["location"]) == (303, "/?kind=episodes")
    assert "httponly" in answer.headers["set-cookie"].lower()
    assert "samesite=strict" in answer.headers["set-cookie"].lower()
    assert stranger.get("/").status_code == 200


def test_token_leads_to_no_other_server(stranger):
    answer = stranger.get("http://127.0.0.1//evil.example/", params={"token": TOKEN}, follow_redirects=False)
    assert answer.headers["location"] == "/evil.example/"


def test_cookies_of_two_servers_do_not_replace_each_other(application):
    names = set()
    for token in (TOKEN, "e" * 32):
        client = TestClient(Access(application, token))
        client.get("/", params={"token": token})
        names |= set(client.cookies)
    assert len(names) == 2


def test_browser_may_load_only_what_this_server_sends(client):
    policy = client.get("/").headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy


def test_a_page_that_fails_may_load_no_more(tmp_path):
    application = create_application(Workplace(ArtifactStore(tmp_path), tmp_path))
    application.add_api_route("/defect", lambda: 1 / 0)
    answer = TestClient(application, raise_server_exceptions=False).get("/defect")
    assert answer.status_code == 500
    assert "default-src 'none'" in answer.headers["content-security-policy"]


@pytest.mark.parametrize("path", ["/nowhere", "/static/nowhere.css", "/static/../application.py"])
def test_unknown_address_is_a_page_with_a_sentence(client, path):
    answer = client.get(path, headers=HTML)
    assert answer.status_code == 404
    assert "There is no page" in answer.text
    assert client.get(path).json()["error"].startswith("there is no page")


def test_what_an_address_does_not_do_is_said(client):
    assert client.delete("/").json()["error"] == "'/' does not answer to DELETE"


def test_foreign_text_in_an_address_is_escaped(client):
    answer = client.get("/%3Cscript%3E%E2%80%AE", headers=HTML)
    assert "<script>\\u" not in answer.text
    assert "&lt;script&gt;\\u202e" in answer.text


def test_commands_stand_out_in_a_sentence_and_foreign_text_in_it_is_escaped(client):
    text = client.get("/artifacts/0123456789abcdef", headers=HTML).text
    assert "No artifact answers to &#39;0123456789abcdef&#39;" in text
    assert "list them with <code>juicer ls</code>." in text
    assert "<code>&lt;b&gt;</code>" in client.get("/artifacts/`<b>`", headers=HTML).text


def test_large_body_is_refused(client):
    answer = client.post("/length", content=b"x" * (MOST_BODY_BYTES + 1))
    assert answer.status_code == 413


def test_large_body_without_a_stated_length_is_refused(client):
    answer = client.post("/length", content=(b"x" * 2**16 for _ in range(MOST_BODY_BYTES // 2**16 + 1)))
    assert answer.status_code == 413


def test_page_leads_to_the_pages_of_other_servers(tmp_path):
    workplace = Workplace(ArtifactStore(tmp_path), tmp_path, servers=lambda: {"MLflow": "http://127.0.0.1:5000"})
    assert 'href="http://127.0.0.1:5000"' in TestClient(create_application(workplace)).get("/").text
