"""From a step of a rollout on its page to a session that goes on from exactly there."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.episode import SIMULATOR, STATE_KEY, Episode, Outcome, Schema, Source
from juicer.seed_ranges import SEED_RANGES, Purpose
from juicer.storage.episodes import write_episodes
from tests.pages.conftest import HTML, commit
from tests.teleoperation.rollouts import stuck_rollout


@pytest.fixture(scope="module")
def stuck() -> Episode:
    return stuck_rollout()


@pytest.fixture(scope="module")
def step(stuck) -> int:
    return len(stuck) - 5


def without_states(episode: Episode) -> Episode:
    schema = Schema(tuple(spec for spec in SIMULATOR if spec.name != STATE_KEY))
    steps = {name: episode.steps[name] for name in schema.names()}
    return Episode(episode.record, steps, {name: episode.final[name] for name in schema.ends}, schema)


@pytest.fixture
def keep(store):
    """Makes an artifact of an episode."""

    def make(episode: Episode, stage: str = "collect") -> ArtifactRef:
        return commit(store, Recipe(stage, "episodes"), {}, lambda folder: write_episodes(folder, [episode], {}))

    return make


@pytest.fixture
def rollouts(keep, stuck) -> ArtifactRef:
    return keep(stuck)


def ask(client, ref: ArtifactRef, **asked: int):
    return client.get("/teleop", params={"artifact": str(ref), "episode": 0, "frame": 0, **asked}, headers=HTML)


def test_the_page_of_a_rollout_leads_to_its_correction(client, rollouts, step):
    shown = client.get("/episodes", params={"artifact": str(rollouts), "episode": 0, "frame": step}, headers=HTML).text
    assert f'href="/teleop?artifact={rollouts}&amp;episode=0&amp;frame={step}">Finish by hand from here</a>' in shown


def test_the_page_of_a_correction_says_what_it_was_grown_from(client, keep, stuck):
    facts = {"source": Source.CORRECTION, "parent": "0123456789abcdef", "parent_step": 7, "log": "a.npz"}
    ref = keep(replace(stuck, record=replace(stuck.record, **facts, episode_id="")), "ingest")
    shown = client.get("/episodes", params={"artifact": str(ref), "episode": 0}, headers=HTML).text
    assert "correction grown from 0123456789abcdef at step 7" in shown
    assert "a.npz" in shown


def test_what_is_no_rollout_that_was_collected_has_no_such_link(client, run):
    for ref in (run.episodes, run.evaluation):
        shown = client.get("/episodes", params={"artifact": str(ref), "episode": 0}, headers=HTML).text
        assert "Finish by hand from here" not in shown


def test_the_form_names_the_step_and_asks_for_no_task(client, rollouts, step):
    shown = ask(client, rollouts, frame=step).text
    assert f'name="step" value="{step}"' in shown
    assert f'name="artifact" value="{rollouts}"' in shown
    assert 'name="task"' not in shown


def test_a_session_goes_on_from_exactly_the_recorded_state(page, rollouts, stuck, step, tmp_path):
    order = {"kind": "correct", "artifact": str(rollouts), "episode": 0, "step": step, "operator": "Anna"}
    page.say(order)
    page.until(lambda: page.status.get("going_on", False) and len(page.frames) > 0, silent=True)
    assert page.status["origin"] == f"step {step} of rollout {stuck.record.episode_id}"
    assert page.status["gripper_closes"]
    page.until(lambda: page.steps() >= 12, "KeyA")
    (path,) = (tmp_path / "teleoperation" / "one_leg" / "drafts").iterdir()
    begun = json.loads(path.read_bytes().splitlines()[0])
    assert (begun["parent"], begun["parent_step"]) == (stuck.record.episode_id, step)
    np.testing.assert_array_equal(begun["state"], stuck.state(step))


def test_an_interrupted_correction_is_offered_with_its_step_even_when_its_rollout_is_gone(page, rollouts, step, store):
    page.say({"kind": "correct", "artifact": str(rollouts), "episode": 0, "step": step})
    page.until(lambda: page.status.get("step", 0) >= 12, "KeyA")
    page.say({"kind": "end"})
    page.until(lambda: not page.status["going_on"] and page.status["drafts"] != [], silent=True)
    shutil.rmtree(store.open(rollouts))
    (draft,) = page.status["drafts"]
    assert draft["parent_step"] == step
    page.say({"kind": "resume", "task": "one_leg", "draft": draft["draft"]})
    page.until(lambda: page.status["going_on"], silent=True)
    assert page.steps() >= 12
    assert page.status["origin"].startswith(f"step {step} of rollout")


def test_a_rollout_that_was_deleted_meanwhile_is_a_sentence_and_what_goes_on_goes_on(page, rollouts, store):
    page.begin()
    shutil.rmtree(store.open(rollouts))
    page.say({"kind": "correct", "artifact": str(rollouts), "episode": 0, "step": 0})
    page.until(lambda: len(page.refusals) == 1)
    assert rollouts.id in page.refusals[0]
    assert page.status["going_on"]
    assert page.status["origin"].startswith("state ")


@pytest.mark.parametrize(
    ("asked", "status", "reason"),
    [
        ({"frame": 10**6}, 409, "episode has steps 0 to"),
        ({"episode": 7}, 404, "has episodes 0 to 0, not 7"),
        ({"episode": -1}, 400, "not valid"),
        ({"frame": "x"}, 400, "not valid"),
        ({"artifact": "0123456789abcdef"}, 404, "0123456789abcdef"),
    ],
)
def test_a_step_that_there_is_not_is_a_page_with_a_sentence(client, rollouts, asked, status, reason):
    answer = ask(client, rollouts, **asked)
    assert answer.status_code == status
    assert '<p class="sentence">' in answer.text
    assert reason in answer.text


def test_what_no_correction_may_be_grown_from_is_a_page_with_a_sentence(client, keep, stuck):
    changes = {
        "only rollouts are finished by hand": {"source": Source.TELEOP},
        "was not collected": {"seed": SEED_RANGES[Purpose.EVALUATION][0]},
        "made under a shift": {"shift": '{"kind":"push"}'},
    }
    for number, (reason, change) in enumerate(changes.items()):
        ref = keep(replace(stuck, record=replace(stuck.record, **change, episode_id="")), f"collect{number}")
        assert reason in ask(client, ref).text
    lost = keep(replace(stuck, record=replace(stuck.record, outcome=Outcome.PART_LOST)), "lost")
    assert "choose an earlier step" in ask(client, lost, frame=len(stuck)).text
    assert "holds no simulator state" in ask(client, keep(without_states(stuck), "foreign")).text


def test_an_episode_of_another_scene_is_a_sentence(page, keep, stuck):
    states = stuck.steps[STATE_KEY][:, :-1]
    final = {**stuck.final, STATE_KEY: stuck.final[STATE_KEY][:-1]}
    other = keep(Episode(stuck.record, {**stuck.steps, STATE_KEY: states}, final), "other")
    unknown = keep(replace(stuck, record=replace(stuck.record, task="rocket", episode_id="")), "unknown")
    for ref in (other, unknown):
        page.say({"kind": "correct", "artifact": str(ref), "episode": 0, "step": 0})
    page.until(lambda: len(page.refusals) == 2, silent=True)
    assert "a simulator state of this scene has" in page.refusals[0]
    assert "no task 'rocket'" in page.refusals[1]
