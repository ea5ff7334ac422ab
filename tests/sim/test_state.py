"""A simulator state is one of this scene and goes on exactly, or it is refused and nothing has changed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from juicer.errors import InvalidEpisode
from juicer.sim.env import AssemblyEnv
from juicer.tasks.registry import TASK_NAMES

ACTION = np.array([0.5, 0.15, 0.02, 0, 1, 0, 1, 0, 0, 1])
MILESTONES, TREES = 6, 6
PROGRESS = slice(-2 - MILESTONES, None)
SLEEP = slice(-2 - MILESTONES - TREES, -2 - MILESTONES)
LEG_POSE = slice(1 + 9 + 7 * 4, 1 + 9 + 7 * 5)
SPEEDS = slice(1 + 9 + 7 * 5, 1 + 9 + 7 * 5 + 9 + 6 * 5)


@pytest.fixture
def env():
    env = AssemblyEnv()
    env.reset(seed=0)
    env.step(ACTION)
    return env


def change(where: Any, value: Any) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    def apply(state: NDArray[np.float64]) -> NDArray[np.float64]:
        state[where] = value
        return state

    return apply


WRONG: dict[str, tuple[Callable[[NDArray[np.float64]], Any], str]] = {
    "NaN": (change(5, np.nan), "NaN or infinite"),
    "infinite": (change(-1, np.inf), "NaN or infinite"),
    "all absurd": (lambda state: np.full_like(state, 1e12), "a position is 1e\\+12"),
    "all zero": (np.zeros_like, "unit length"),
    "random": (lambda state: np.random.default_rng(0).normal(size=state.shape), "not a simulator state"),
    "a part a light second away": (change(LEG_POSE, [3e8, 0, 0, 1, 0, 0, 0]), "a position is 3e\\+08"),
    "no quaternion": (change(LEG_POSE, 0.1), "unit length"),
    "too fast": (change(SPEEDS, 1e3), "speed is"),
    "an absurd force": (change(slice(SPEEDS.stop, SPEEDS.stop + 1), 1e12), "force"),
    "too short": (lambda state: state[:-1], "has .* entries of float64"),
    "too long": (lambda state: np.append(state, 0.0), "has .* entries of float64"),
    "a row": (lambda state: state[None], "has .* entries"),
    "single precision": (lambda state: state.astype(np.float32), "got float32"),
    "whole numbers": (lambda state: state.astype(np.int64), "got int64"),
    "text": (lambda state: state.astype(str), "entries of float64"),
    "objects": (lambda state: state.astype(object), "got object"),
    "nothing": (lambda state: None, "got NoneType"),
    "a ragged list": (lambda state: [[1.0], [1.0, 2.0]], "got list"),
    "a dictionary": (lambda state: {"state": state}, "got dict"),
    "sleeps after an unknown tree": (change(SLEEP, [-11, 99, 2, 3, 4, 5]), "in cycles"),
    "sleeps after nobody in a cycle": (change(SLEEP, [-11, 2, 3, 3, 4, 5]), "in cycles"),
    "sleeps after one that is awake": (change(SLEEP, [-11, -1, 1, 3, 4, 5]), "in cycles"),
    "half asleep": (change(SLEEP, [-11, 1.5, 2, 3, 4, 5]), "in cycles"),
    "the robot sleeps": (change(SLEEP, [0, 1, 2, 3, 4, 5]), "the robot sleeps"),
    "awake for ever": (change(SLEEP, [-2e9, 1, 2, 3, 4, 5]), "sleep counter"),
    "awake by halves": (change(SLEEP, [-1.5, 1, 2, 3, 4, 5]), "sleep counter"),
    "negative steps": (change(PROGRESS, [-1] + [0] * 7), "whole steps"),
    "half a step": (change(PROGRESS, [0.5] + [0] * 7), "whole steps"),
    "endless steps": (change(PROGRESS, [1e12] + [0] * 7), "whole steps"),
    "assembled twice": (change(PROGRESS, [5, 2] + [-1] * 6), "neither 0 nor 1"),
    "a milestone of the future": (change(PROGRESS, [5, 0, 6] + [-1] * 5), "milestone"),
    "a milestone before time": (change(PROGRESS, [5, 0, -2] + [-1] * 5), "milestone"),
}


@pytest.mark.parametrize(("spoil", "problem"), WRONG.values(), ids=WRONG)
def test_what_is_no_state_is_refused_and_nothing_has_changed(
    env: AssemblyEnv, spoil: Callable[[NDArray[np.float64]], Any], problem: str
):
    before = env.get_state()
    seen, touching = env.observation(), env.contact_pairs()
    with pytest.raises(InvalidEpisode, match=problem):
        env.set_state(spoil(env.get_state()))
    np.testing.assert_array_equal(env.get_state(), before)
    np.testing.assert_array_equal(env.observation()["proprioception"], seen["proprioception"])
    assert env.contact_pairs() == touching


def test_what_mujoco_cannot_go_on_from_is_refused_too(env: AssemblyEnv, monkeypatch: pytest.MonkeyPatch):
    before, forward = env.get_state(), mujoco.mj_forward
    calls = []

    def fail_once(*arguments: Any) -> None:
        calls.append(1)
        if len(calls) == 1:
            raise mujoco.FatalError("out of memory")
        forward(*arguments)

    monkeypatch.setattr(mujoco, "mj_forward", fail_once)
    other = AssemblyEnv()
    other.reset(seed=1)
    with pytest.raises(InvalidEpisode, match="cannot go on from this simulator state: out of memory"):
        env.set_state(other.get_state())
    np.testing.assert_array_equal(env.get_state(), before)


def test_a_list_of_the_same_numbers_is_the_same_state(env: AssemblyEnv):
    state = env.get_state()
    env.step(ACTION)
    env.set_state(state.tolist())
    np.testing.assert_array_equal(env.get_state(), state)


def test_the_state_handed_in_is_not_kept(env: AssemblyEnv):
    state = env.get_state()
    env.set_state(state)
    before = env.get_state()
    state[:] = 0
    np.testing.assert_array_equal(env.get_state(), before)


@pytest.mark.parametrize("task", TASK_NAMES)
def test_every_state_that_an_environment_gives_can_be_set_again(task: str):
    env, other = AssemblyEnv(task), AssemblyEnv(task)
    other.set_state(env.get_state())  # also before the first reset
    rng = np.random.default_rng(0)
    for seed in range(3):
        env.reset(seed=seed)
        env.data.tree_asleep[:] = -11
        for _ in range(15):
            # Violent ones: the hand is thrown about among the parts.
            action = np.concatenate([rng.uniform([0.3, -0.3, -0.1], [0.7, 0.3, 0.2]), rng.uniform(-1, 1, 7)])
            *_, info = env.step(action)
            if info["outcome"] == "diverged":
                break
            other.set_state(env.get_state())
            np.testing.assert_array_equal(other.get_state(), env.get_state())


def test_the_final_state_of_a_divergence_says_what_it_is(env: AssemblyEnv):
    env.data.qvel[12] = np.nan
    env.step(ACTION)
    with pytest.raises(InvalidEpisode, match="the simulation had diverged there"):
        AssemblyEnv().set_state(env.get_state())
