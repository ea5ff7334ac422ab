"""Pages answer whoever knows the token, in sentences, and let a browser do nothing that they do not need."""

from __future__ import annotations

import re
from typing import Annotated

import pytest
from pydantic import AfterValidator, BaseModel
from starlette.testclient import TestClient

from juicer.artifacts.store import ArtifactStore
from juicer.errors import ConfigError
from juicer.pages.access import MAX_AGE_SECONDS, Access
from juicer.pages.annotating.sheets import draw_sheet
from juicer.pages.application import create_application
from juicer.pages.limits import MOST_BODY_BYTES
from juicer.pages.rendering import TEMPLATES
from juicer.pages.workplace import Workplace

HTML = {"accept": "text/html"}
TOKEN = "f" * 32


def _refuse_name(name: str) -> str:
    raise ValueError(f"'{name}' is not a name")


class Named(BaseModel):
    """A body whose name is always refused."""

    name: Annotated[str, AfterValidator(_refuse_name)]


@pytest.fixture
def application(tmp_path):
    application = create_application(Workplace(ArtifactStore(tmp_path), tmp_path))

    @application.post("/length")
    async def length(request: dict[str, str]):
        return len(request)

    @application.post("/named")
    async def named(request: Named):
        return request.name

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
    assert "samesite=lax" in answer.headers["set-cookie"].lower()
    assert f"max-age={MAX_AGE_SECONDS}" in answer.headers["set-cookie"].lower()
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


@pytest.mark.parametrize("accept", [{}, HTML])
@pytest.mark.parametrize(("path", "allowed"), [("/", "GET, HEAD"), ("/static/pages.css", "GET, HEAD")])
def test_what_an_address_answers_to_instead_is_told(client, path, allowed, accept):
    answer = client.delete(path, headers=accept)
    assert (answer.status_code, answer.headers["allow"]) == (405, allowed)
    assert client.get("/length").headers["allow"] == "POST"


@pytest.mark.parametrize("path", ["/", "/episodes", "/annotate", "/teleop", "/static/pages.css", "/nowhere"])
def test_head_is_answered_like_get_without_a_body(client, path):
    answer, whole = client.head(path, headers=HTML), client.get(path, headers=HTML)
    assert (answer.status_code, answer.content) == (whole.status_code, b"")
    assert answer.headers["content-length"] == str(len(whole.content))
    assert answer.headers["content-type"] == whole.headers["content-type"]


def test_head_of_what_only_takes_something_is_refused(client):
    answer = client.head("/length")
    assert (answer.status_code, answer.headers["allow"], answer.content) == (405, "POST", b"")


def test_body_that_is_no_json_is_said_to_be_none(client):
    answer = client.post("/length", content="{", headers={"content-type": "application/json"})
    assert answer.status_code == 400
    assert answer.json()["error"].startswith("the body is not JSON: expecting property name")


def test_mistake_in_a_body_is_told_in_our_words_only(client):
    answer = client.post("/named", json={"name": "x"})
    assert (answer.status_code, answer.json()["error"]) == (400, "'name' is not valid: 'x' is not a name")
    assert client.post("/named", json=1).json()["error"].startswith("the request is not valid: ")


def test_titles_of_pages_end_alike():
    pages = [path for path in TEMPLATES.rglob("*.html") if path.name not in ("base.html", "parts.html")]
    titles = [re.findall(r"block title %}(.*?){% endblock", path.read_text()) for path in pages]
    assert len(titles) > 5
    assert [each for each in titles if len(each) != 1 or not each[0].endswith(" · juicer")] == []


@pytest.mark.parametrize("views", [["front"] * 300, ["front", "wrist", "front"], []])
def test_sheet_for_annotators_shows_a_view_once(episode_factory, views):
    with pytest.raises(ConfigError, match="each once at most"):
        draw_sheet(episode_factory(), 0, 1, views)


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
