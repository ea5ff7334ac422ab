"""Every address answers in a sentence, whatever it is asked for; the addresses are those that the pages really have."""

from __future__ import annotations

from collections.abc import Iterator
from urllib.parse import quote

import pytest
from fastapi.routing import APIRoute
from starlette.testclient import TestClient

from juicer.pages.annotating.routes import router as annotating
from juicer.pages.application import AREAS, create_application
from juicer.pages.workplace import Workplace

FOREIGN = (
    "",
    "0",
    "-1",
    "999999999",
    "9" * 30,
    "9" * 5000,
    "1.5",
    "nan",
    "true",
    "\0",
    "\ud800".encode("utf-8", "surrogatepass"),
    b"\xff\xfe",
    "\u202e<script>",
    "../../../../etc/passwd",
    "a/../b",
    "%2e%2e%2f",
    "x" * 4000,
    "'; drop table",
    "{}",
    "*",
    "episodes",
)
"""What nobody types, for every part of an address; some mean something in one place or another."""
BODIES = (
    b"",
    b"null",
    b"[]",
    b"{}",
    b"\xff",
    b"[" * 100_000,
    b'{"author": ' + b"9" * 5000 + b"}",
    b'{"author": "a", "marks": [{"episode": "\\ud800", "critical_state": 0, "after": 0, "step": 0}]}',
    b'{"author": "a", "marks": [{"episode": "x", "critical_state": NaN, "after": 1e999, "step": -1}]}',
    b'{"author": "a", "episode": "\\u0000", "critical_state": 0, "after": 0}',
)
ANSWERS = {200, 303, 307, 400, 404, 405, 409, 422}


def _routes() -> list[APIRoute]:
    return [route for area in AREAS for route in area.routes if isinstance(route, APIRoute)]


def _names(route: APIRoute) -> tuple[list[str], list[str]]:
    """Parameters of a route in its path, and behind it."""
    dependant = route.dependant
    return [each.name for each in dependant.path_params], [each.alias for each in dependant.query_params]


def _addresses(route: APIRoute, usual: dict[str, str]) -> Iterator[str]:
    """Of a route, every parameter with everything foreign, the others as usual."""
    within, behind = _names(route)
    for name in [*within, *behind]:
        for foreign in FOREIGN:
            values = {**usual, name: foreign}
            path = route.path.replace(":path", "")
            for each in within:
                path = path.replace(f"{{{each}}}", quote(values[each], safe=""))
            query = "&".join(f"{each}={quote(values[each], safe='')}" for each in behind if each in values)
            yield f"{path}?{query}"


@pytest.fixture
def client(run, tmp_path) -> TestClient:
    application = create_application(Workplace(run.store, tmp_path))
    return TestClient(application, raise_server_exceptions=False, follow_redirects=False)


@pytest.mark.parametrize("kind", ["episodes", "evaluation"])
@pytest.mark.parametrize("route", _routes(), ids=lambda route: f"{min(route.methods)} {route.path}")
def test_foreign_parameters_are_answered_in_a_sentence(client, run, insertions, route, kind):
    artifact = getattr(run, kind).id
    episode = insertions[0].record.episode_id if route in annotating.routes else "0"
    usual = {"text": artifact, "artifact": artifact, "name": artifact, "episode": episode}
    usual |= {"ending": "csv", "first": "0", "frame": "0"}
    failed = []
    for address in _addresses(route, usual):
        for method in route.methods:
            answer = client.request(method, address, json=None if method == "GET" else {})
            if not _is_understandable(answer):
                failed.append((address[:200], answer.status_code, answer.text[:200]))
    assert not failed


@pytest.mark.parametrize("route", [each for each in _routes() if "POST" in each.methods], ids=lambda route: route.path)
@pytest.mark.parametrize("body", BODIES, ids=lambda body: body[:60].decode("latin-1"))
def test_foreign_bodies_are_answered_in_a_sentence(client, run, route, body):
    address = route.path.replace("{name}", run.episodes.id)
    answer = client.post(address, content=body, headers={"content-type": "application/json"})
    assert _is_understandable(answer), answer.text
    assert answer.status_code != 200


def _is_understandable(answer) -> bool:
    if answer.status_code < 400:
        return answer.status_code in ANSWERS
    return answer.status_code in ANSWERS and len(answer.json()["error"]) < 1000
