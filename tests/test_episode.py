"""Episodes are checked against their schema, and known by what was recorded."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from juicer.episode import DEMONSTRATION, SIMULATOR, ArraySpec, Episode, EpisodeRecord, Outcome, Role, Schema, Source
from juicer.errors import InvalidEpisode, StateMissing

EpisodeFactory = Callable[..., Episode]

FOREIGN = Schema(
    (
        ArraySpec("joints", (7,), "float32", Role.OBSERVATION),
        ArraySpec("front", (96, 96, 3), "uint8", Role.OBSERVATION),
        ArraySpec("action", (7,), "float32", Role.ACTION),
    )
)
RECORD = EpisodeRecord(Source.TELEOP, "one_leg", "low", 0, Outcome.SUCCESS)


def foreign(length: int = 6) -> Episode:
    """An episode of another project, without a simulator state."""
    steps = {spec.name: np.ones((length, *spec.shape), spec.dtype) for spec in FOREIGN}  # type: ignore[misc]
    return Episode(RECORD, steps, {name: steps[name][-1] for name in FOREIGN.ends}, FOREIGN)


def test_an_episode_of_other_arrays_is_checked_against_its_own_schema():
    episode = foreign()
    assert len(episode) == 6
    assert set(episode.observation(6)) == {"joints", "front"}
    with pytest.raises(InvalidEpisode, match=r"'action' of an episode must hold float32 of shape \(7\) a step"):
        replace(episode, steps={**episode.steps, "action": np.ones((6, 10), np.float32)})
    with pytest.raises(InvalidEpisode, match=r"needs the arrays \['action', 'part_poses'"):
        replace(episode, schema=SIMULATOR)


def test_what_needs_a_simulator_state_says_that_there_is_none():
    with pytest.raises(StateMissing, match="holds no simulator state, so none of its steps can be restored"):
        foreign().state(0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda e: {"steps": {**e.steps, "action": e.steps["action"][:, :9]}}, r"got float32 of shape \(9,\)"),
        (lambda e: {"steps": {**e.steps, "sim_state": e.steps["sim_state"].astype(np.float32)}}, "must hold float64"),
        (lambda e: {"steps": {**e.steps, "reward": e.steps["reward"] * np.nan}}, "'reward' of an episode holds NaN"),
        (lambda e: {"steps": {**e.steps, "reward": e.steps["reward"][1:]}}, "need one common, positive length"),
        (lambda e: {"steps": {name: values[:0] for name, values in e.steps.items()}}, "positive length"),
        (lambda e: {"final": {**e.final, "part_poses": e.final["part_poses"][7:]}}, "final 'part_poses'"),
        (lambda e: {"final": {"part_poses": e.final["part_poses"]}}, "the final observation needs"),
    ],
)
def test_arrays_that_contradict_the_schema_are_refused(episode_factory: EpisodeFactory, change, message):
    episode = episode_factory()
    with pytest.raises(InvalidEpisode, match=message):
        replace(episode, **change(episode))


def test_a_recording_has_the_same_id_whatever_else_is_said_of_it(episode_factory: EpisodeFactory):
    episode = episode_factory(seed=3)
    facts = {"device": "keyboard", "operator": "Ada", "log": "demo.npz", "milestones": {"leg_lifted": 3}}
    again = episode_factory(seed=3, **facts)
    assert again.record.episode_id == episode.record.episode_id
    assert len(episode.record.episode_id) == 16
    int(episode.record.episode_id, 16)


def test_another_recording_has_another_id(episode_factory: EpisodeFactory):
    episode = episode_factory(seed=3)
    action = episode.steps["action"].copy()
    action[4, 0] = np.nextafter(action[4, 0], 1)
    anonymous = replace(episode.record, episode_id="")
    others = [
        replace(episode, record=anonymous, steps={**episode.steps, "action": action}),
        replace(episode, record=replace(anonymous, source=Source.ROLLOUT)),
        replace(episode, record=replace(anonymous, seed=4)),
        replace(episode, record=replace(anonymous, task="lamp")),
    ]
    assert len({each.record.episode_id for each in (episode, *others)}) == 5


def test_steps_of_a_recording_are_found_in_its_demonstration(episode_factory: EpisodeFactory):
    plain = episode_factory(5)
    numbers = np.array([2, 3, 4, 7, 8], np.int32)
    kept = {"recorded_step": numbers, "continuous": np.diff(numbers, append=9) == 1}
    demonstration = replace(plain, steps={**plain.steps, **kept}, schema=DEMONSTRATION)
    assert [demonstration.step_of(step) for step in range(-1, 10)] == [None, 0, 0, 0, 1, 2, 2, 2, 3, 4, None]
    assert [demonstration.recorded_step(step) for step in range(6)] == [2, 3, 4, 7, 8, 9]
    assert [plain.step_of(4), plain.step_of(5), plain.recorded_step(4)] == [4, None, 4]


ENTRY = FOREIGN.to_json()[0]


def test_a_schema_reads_back():
    assert Schema.from_json(FOREIGN.to_json()) == FOREIGN


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ([ENTRY | {"name": "../etc"}], "cannot be the name of an array"),
        ([ENTRY | {"dtype": "O"}], "cannot hold 'O'"),
        ([ENTRY | {"dtype": "float99"}], "cannot hold 'float99'"),
        ([ENTRY | {"shape": [-1]}], "cannot have the shape"),
        ([ENTRY | {"role": "spy"}], "'spy' is not a valid Role"),
        ([{"name": "joints"}], "its arrays are not described"),
        ([ENTRY, ENTRY], "two arrays of an episode have one name"),
        *[(content, "its arrays are not described") for content in (None, 3, [3], "text", [ENTRY | {"shape": ["a"]}])],
    ],
)
def test_a_schema_that_is_none_is_refused(content: object, message: str):
    with pytest.raises(ValueError, match=message):
        Schema.from_json(content)


def test_whole_numbers_are_not_converted_to_be_checked():
    steps = {spec.name: np.zeros((400, *spec.shape), spec.dtype) for spec in FOREIGN}  # type: ignore[misc]
    final = {name: steps[name][-1] for name in FOREIGN.ends}
    record = replace(RECORD, episode_id="known")
    tracemalloc.start()
    Episode(record, steps, final, FOREIGN)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 0.1 * steps["front"].nbytes


@pytest.mark.parametrize("step", [10**9, -(10**9)])
def test_a_step_that_is_not_there_is_refused(episode_factory: EpisodeFactory, step: int):
    episode = episode_factory(length=5)
    assert np.array_equal(episode.state(5), episode.final["sim_state"])
    with pytest.raises(StateMissing, match=f"the episode has steps 0 to 4 and the end, 5, not {step}"):
        episode.state(step)
