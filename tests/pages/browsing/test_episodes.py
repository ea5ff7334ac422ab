"""Episodes are listed, chosen by how they failed, and drawn step by step."""

from __future__ import annotations

import io
import re
from dataclasses import replace

import numpy as np
import PIL.Image
import pytest

from juicer.artifacts.recipe import Recipe
from juicer.episode import Outcome
from juicer.pages.browsing.frames import FRAME_HEIGHT, FRAME_WIDTH, SHEET_COLUMNS
from juicer.storage.episodes import write_episodes
from juicer.storage.evaluations import EvaluationRow, write_evaluation
from tests.pages.conftest import commit


def linked(text: str) -> list[int]:
    return sorted({int(number) for number in re.findall(r'href="/episodes\?artifact=[^"]*episode=([0-9]+)"', text)})


def test_episodes_are_listed_with_links_to_those_kept(client, run):
    text = client.get("/episodes", params={"artifact": str(run.episodes)}).text
    assert linked(text) == [0, 1]
    assert "✓ success" in text


def test_evaluation_lists_every_episode_and_shows_those_that_it_kept(client, run):
    text = client.get("/episodes", params={"artifact": str(run.evaluation)}).text
    assert linked(text) == [0, 1]
    assert text.count("<img") == 1
    assert "✗ timeout" in text
    shown = client.get("/episodes", params={"artifact": str(run.evaluation), "episode": 1})
    assert f"juicer replay {run.evaluation.id} --episode 1" in shown.text


@pytest.fixture
def outcomes(store):
    """An evaluation as unpacking the records of a study makes it: without examples."""
    rows = [
        EvaluationRow(0, 76, Outcome.SUCCESS, 1, 300, {"top_placed": 30, "leg_screwed": 300}),
        EvaluationRow(1, 77, Outcome.TIMEOUT, 0, 600, {"top_placed": 40}),
    ]
    recipe = Recipe("evaluate", "evaluation", tasks={"one_leg": {}})
    return commit(store, recipe, {}, lambda folder: write_evaluation(folder, rows))


def test_evaluation_without_examples_lists_every_episode_and_says_how_to_see_one(client, outcomes):
    asked = {"artifact": str(outcomes)}
    answer = client.get("/episodes", params=asked)
    assert answer.status_code == 200
    assert linked(answer.text) == [0, 1]
    assert "<img" not in answer.text
    assert "hold no simulator states" not in answer.text
    assert f"juicer replay {outcomes.id} --episode NUMBER" in answer.text
    shown = client.get("/episodes", params={**asked, "episode": 0}).text
    assert f"juicer replay {outcomes.id} --episode 0" in shown


@pytest.mark.parametrize(("lacking", "numbers"), [("leg_lifted", [1]), ("leg_upright", [])])
def test_failures_of_an_evaluation_without_examples_are_told_by_its_task(client, outcomes, lacking, numbers):
    asked = {"artifact": str(outcomes), "lacking": lacking}
    assert linked(client.get("/episodes", params=asked).text) == numbers


@pytest.mark.parametrize("name", ["sheet", "still"])
def test_image_of_an_evaluation_without_examples_is_refused_with_a_remedy(client, outcomes, name):
    asked = {"artifact": str(outcomes), "episode": 0, "frame": 0}
    answer = client.get(f"/episodes/{name}.jpg", params=asked, headers={"accept": "*/*"})
    assert answer.status_code == 404
    assert "juicer replay" in answer.json()["error"]


@pytest.mark.parametrize(
    ("asked", "seeds"),
    [({"outcome": "failure"}, {77}), ({"outcome": "success"}, {0}), ({"lacking": "leg_lifted"}, {77})],
)
def test_failures_are_chosen(client, run, asked, seeds):
    text = client.get("/episodes", params={"artifact": str(run.evaluation), **asked}).text
    assert ("✗ timeout" in text) is (77 in seeds)
    assert ("✓ success" in text) is (77 not in seeds)


def test_failure_leads_to_the_step_of_its_last_milestone_and_says_what_was_missed(client, store, insertions):
    record = replace(insertions[0].record, outcome=Outcome.TIMEOUT, milestones={"top_placed": 3, "leg_lifted": 8})
    ref = commit(
        store,
        Recipe("collect", "episodes"),
        {"episodes": 1, "successes": 0},
        lambda folder: write_episodes(folder, [replace(insertions[0], record=record)], {}),
    )
    assert f'href="/episodes?artifact={ref}&amp;outcome=failure"' in client.get(f"/artifacts/{ref}").text
    failures = client.get("/episodes", params={"artifact": str(ref), "outcome": "failure"}).text
    assert f'href="/episodes?artifact={ref}&amp;episode=0&amp;frame=8">✗ leg upright</a>' in failures
    episode = client.get("/episodes", params={"artifact": str(ref), "episode": 0}).text
    assert "leg upright was not reached" in episode


def test_address_of_a_frame_opens_there(client, run):
    asked = {"artifact": str(run.episodes), "episode": 1, "frame": 7}
    assert 'data-frame="7"' in client.get("/episodes", params=asked).text


def test_frame_behind_the_end_is_the_end(client, run, insertions):
    asked = {"artifact": str(run.episodes), "episode": 0, "frame": 10**6}
    assert f'data-frame="{len(insertions[0])}"' in client.get("/episodes", params=asked).text


@pytest.mark.parametrize("asked", [{"episode": 2}, {"episode": -1}, {"episode": "x"}, {"episode": 10**12}])
def test_unknown_episode_is_a_page_with_a_sentence(client, run, asked):
    answer = client.get("/episodes", params={"artifact": str(run.episodes), **asked})
    assert answer.status_code in (400, 404)
    assert '<p class="sentence">' in answer.text


def test_artifact_without_episodes_is_refused_with_a_sentence(client, run):
    answer = client.get("/episodes", params={"artifact": str(run.checkpoint)})
    assert answer.status_code == 404
    assert "holds no episodes" in answer.text


def test_artifact_whose_episodes_are_none_says_so(client, store):
    ref = commit(
        store,
        Recipe("collect", "episodes"),
        {},
        lambda folder: write_episodes(folder, (), {}, may_be_empty=True),
    )
    assert "There is no episode in it" in client.get("/episodes", params={"artifact": str(ref)}).text


def image_of(answer) -> np.ndarray:
    assert answer.status_code == 200, answer.text
    return np.asarray(PIL.Image.open(io.BytesIO(answer.content)))


@pytest.mark.usefixtures("drawing")
def test_sheet_holds_the_steps_that_were_asked_for(client, run, insertions):
    asked = {"artifact": str(run.episodes), "episode": 0, "first": 0, "stride": 1, "count": 12}
    image = image_of(client.get("/episodes/sheet.jpg", params=asked))
    assert image.shape == (2 * FRAME_HEIGHT, SHEET_COLUMNS * FRAME_WIDTH, 3)
    later = image_of(client.get("/episodes/sheet.jpg", params={**asked, "first": 11, "count": 1}))
    eleventh = image[FRAME_HEIGHT:, FRAME_WIDTH : 2 * FRAME_WIDTH].astype(int)
    # Compressed with other neighbours.
    assert np.abs(later.astype(int) - eleventh).mean() < 3
    assert np.abs(later.astype(int) - image[:FRAME_HEIGHT, :FRAME_WIDTH].astype(int)).mean() > 3


@pytest.mark.usefixtures("drawing")
def test_still_is_drawn_of_every_step_and_of_the_end(client, run, insertions):
    asked = {"artifact": str(run.episodes), "episode": 0}
    end = len(insertions[0])
    assert image_of(client.get("/episodes/still.jpg", params={**asked, "frame": end})).shape == (360, 1120, 3)
    answer = client.get("/episodes/still.jpg", params={**asked, "frame": end + 1}, headers={"accept": "*/*"})
    assert answer.status_code == 409
    assert "has steps 0 to" in answer.json()["error"]


@pytest.mark.parametrize("asked", [{"count": 51}, {"count": 0}, {"stride": 0}, {"first": -1}])
def test_sheet_is_bounded(client, run, asked):
    answer = client.get("/episodes/sheet.jpg", params={"artifact": str(run.episodes), "episode": 0, **asked})
    assert answer.status_code == 400
