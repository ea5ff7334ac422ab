"""The lineage shows what an artifact was made from and what was made of it, with what each of them holds."""

from __future__ import annotations

import io
import re

import PIL.Image
import pytest

from juicer.artifacts.recipe import Recipe
from juicer.pages.browsing import graph
from tests.pages.conftest import commit


def boxes(text: str) -> set[str]:
    drawing = re.search(r"<svg class=\"lineage\".*?</svg>", text, re.DOTALL)[0]
    return set(re.findall(r'href="/lineage\?artifact=([a-z]+/[0-9a-f]{16})"', drawing))


@pytest.mark.parametrize("name", ["logs", "episodes", "checkpoint", "evaluation"])
def test_run_is_shown_whole_from_each_of_its_artifacts(client, run, name):
    text = client.get("/lineage", params={"artifact": str(getattr(run, name))}).text
    assert boxes(text) == {str(ref) for ref in (run.logs, run.episodes, run.checkpoint, run.evaluation)}


def test_boxes_show_what_their_artifacts_hold(client, run):
    text = client.get("/lineage", params={"artifact": str(run.evaluation)}).text
    assert f"/lineage/strip.jpg?artifact={run.episodes}" in text
    assert 'class="curve first"' in text
    assert ">50%<" in text
    assert ">10 to 90%<" in text


@pytest.mark.parametrize("address", ["/lineage", "/episodes"])
def test_number_that_is_none_is_refused_and_one_behind_the_end_told(client, run, address):
    assert client.get(address, params={"first": "0"}).status_code == 200
    assert client.get(address, params={"first": "soon"}).status_code == 400
    assert "The list ends before number 5001" in client.get(address, params={"first": "5000"}).text


def test_drawing_needs_no_style_that_the_policy_forbids(client, run):
    assert "style=" not in client.get("/lineage", params={"artifact": str(run.evaluation)}).text


@pytest.mark.usefixtures("drawing")
def test_strip_is_drawn(client, run):
    answer = client.get("/lineage/strip.jpg", params={"artifact": str(run.episodes)})
    assert PIL.Image.open(io.BytesIO(answer.content)).size == (320, 120)


def test_ancestor_that_is_gone_is_shown_as_such(client, run):
    run.store.set_aside(run.checkpoint)
    text = client.get("/lineage", params={"artifact": str(run.evaluation)}).text
    assert boxes(text) == {str(run.checkpoint), str(run.evaluation)}
    assert "no longer there" in text


def test_of_a_huge_lineage_the_nearest_are_shown(client, run, monkeypatch):
    monkeypatch.setattr(graph, "MOST_ARTIFACTS", 3)
    for seed in range(4):
        commit(run.store, Recipe("analyse", "analysis", {"of": (run.evaluation,)}, config={"seed": seed}), {})
    text = client.get("/lineage", params={"artifact": str(run.evaluation)}).text
    assert len(boxes(text)) == 3
    assert "5 more belong to it" in text
