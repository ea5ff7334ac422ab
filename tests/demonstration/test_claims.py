"""What a recording claims is compared with what the simulator says of its states."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from juicer.demonstration.claims import ClaimChecker
from juicer.demonstration.ingestion import Ingestion, IngestionConfig
from juicer.demonstration.log import OperatorLog
from juicer.demonstration.recording import recordings
from juicer.errors import RejectedLog
from juicer.expert.operator import scripted_operators
from juicer.sim.env import AssemblyEnv

Array = NDArray[Any]
STATES = ("sim_state",)


def changed(log: OperatorLog, change: Callable[[Array], Array], *names: str) -> OperatorLog:
    """The log with some arrays changed, those after the last step likewise."""
    whole = {name: change(np.vstack([log.steps[name], log.final[name]])) for name in names}
    steps = {**log.steps, **{name: values[:-1] for name, values in whole.items()}}
    return replace(log, steps=steps, final={**log.final, **{name: values[-1] for name, values in whole.items()}})


def with_arrays(log: OperatorLog, **arrays: Array) -> OperatorLog:
    return replace(log, steps={**log.steps, **arrays})


def at_rest(log: OperatorLog) -> OperatorLog:
    """A log that stays where its reset put it, step after step, and yet claims success."""
    env = AssemblyEnv(log.task)
    env.reset(seed=log.seed)
    states = np.tile(env.get_state(), (len(log) + 1, 1))
    states[:, 0] = np.arange(len(states)) * 0.1
    return with_states(log, env, states)


def with_states(log: OperatorLog, env: AssemblyEnv, states: Array) -> OperatorLog:
    shown = []
    for state in states:
        env.set_state(state)
        shown.append({**env.observation(), "sim_state": state})
    steps = {name: np.stack([entry[name] for entry in shown[:-1]]) for name in shown[0]}
    return replace(log, steps={**log.steps, **steps}, final=shown[-1])


def one_more(reward: Array) -> Array:
    return reward + np.eye(1, len(reward), 5, dtype=np.float32)[0]


rng = np.random.default_rng(0)
FORGERIES: Mapping[str, tuple[Callable[[OperatorLog], OperatorLog], str]] = {
    "random states": (
        lambda log: changed(log, lambda s: rng.normal(size=s.shape), *STATES),
        "simulator state of step 0",
    ),
    "zero states": (lambda log: changed(log, np.zeros_like, *STATES), "simulator state of step 1 is not of the moment"),
    "huge states": (lambda log: changed(log, lambda s: np.full_like(s, 1e12), *STATES), "beyond all that a simulation"),
    "huge velocities": (
        lambda log: changed(log, lambda s: huge_velocities(s), *STATES),
        "proprioception of step|restored",
    ),
    "part poses of another part": (
        lambda log: changed(log, lambda poses: np.roll(poses, 7, axis=1), "part_poses"),
        "simulator state of step 0 has its parts elsewhere than the recorded part poses",
    ),
    "states of another moment": (
        lambda log: changed(log, lambda s: np.roll(s, 1, axis=0), *STATES),
        "of the moment of",
    ),
    "a gripper that is wider": (
        lambda log: changed(log, lambda p: p + np.eye(1, 16, 15, dtype=np.float32), "proprioception"),
        "another gripper width",
    ),
    "a hand elsewhere": (
        lambda log: changed(log, lambda p: p + np.eye(1, 16, 0, dtype=np.float32) / 100, "proprioception"),
        "not the one that a reset to seed 0|proprioception of step",
    ),
    "another seed": (
        lambda log: replace(log, seed=2),
        "first state is not the one that a reset to seed 2 at low random",
    ),
    "another randomness": (lambda log: replace(log, randomness="med"), "a reset to seed 0 at med randomness gives"),
    "rewards of a million": (
        lambda log: with_arrays(log, reward=log.steps["reward"] + 1e6),
        "must be a number of pairs",
    ),
    "a share of a reward": (lambda log: with_arrays(log, reward=log.steps["reward"] / 2), "must be a number of pairs"),
    "one reward too many": (lambda log: with_arrays(log, reward=one_more(log.steps["reward"])), "rewards add up to 2"),
    "a reward too early": (
        lambda log: with_arrays(log, reward=np.roll(log.steps["reward"], -9)),
        "counts other assembled",
    ),
    "success with no pair assembled": (at_rest, "counts other|of the moment"),
    "a milestone of another task": (
        lambda log: replace(log, milestones={"bulb_lifted": 3}),
        "unknown milestone 'bulb_lifted'",
    ),
    "a milestone after the end": (
        lambda log: replace(log, milestones={"leg_lifted": len(log) + 1}),
        "milestone 'leg_lifted' after",
    ),
    "a milestone too early": (
        lambda log: replace(log, milestones={"leg_screwed": 3}),
        "which that state does not show",
    ),
    "actions a step late": (
        lambda log: with_arrays(log, action=np.roll(log.steps["action"], 1, axis=0)),
        "does not lead from its simulator state to the next",
    ),
    "actions of nobody": (
        lambda log: with_arrays(log, action=np.tile(log.steps["action"][:1], (len(log), 1))),
        "does not lead from its simulator state to the next",
    ),
}


def huge_velocities(states: Array) -> Array:
    states = states.copy()
    env = AssemblyEnv("one_leg")
    states[1:, 1 + env.model.nq : 1 + env.model.nq + env.model.nv] = 1e9
    return states


@pytest.mark.parametrize(("forge", "reason"), FORGERIES.values(), ids=list(FORGERIES))
def test_a_forged_recording_is_rejected(
    recording: OperatorLog, forge: Callable[[OperatorLog], OperatorLog], reason: str
):
    with pytest.raises(RejectedLog, match=reason):
        Ingestion(IngestionConfig(task="one_leg")).ingest_log(forge(recording))


def test_success_is_measured_on_the_parts_and_not_on_what_the_state_says_of_itself(recording: OperatorLog):
    """A log whose every number agrees with the others, but the leg is not where it should be."""
    env = AssemblyEnv("one_leg")
    states = np.vstack([recording.steps["sim_state"], recording.final["sim_state"]])
    leg = env.model.joint(env.task.parts[env.task.pairs[0].second].name).qposadr[0]
    states[-1, 1 + leg] += 0.02
    forged = replace(with_states(recording, env, states), milestones={})
    with pytest.raises(RejectedLog, match="has the reward 1, but 0 pairs are newly assembled"):
        ClaimChecker("one_leg").check(forged)


def test_sleep_that_would_send_the_simulator_round_in_circles_is_rejected(recording: OperatorLog):
    size = ClaimChecker("one_leg").state_size
    progress = 1 + len(AssemblyEnv("one_leg").task.pairs) + len(AssemblyEnv("one_leg").task.milestones)
    states = np.array(recording.steps["sim_state"])
    states[7, size - progress - 2 : size - progress] = [1, 0.5]
    with pytest.raises(RejectedLog, match="step 7 has sleeping bodies that no scene has"):
        ClaimChecker("one_leg").check(with_arrays(recording, sim_state=states))


@pytest.mark.parametrize(("task", "randomness"), [("lamp", "med"), ("round_table", "low"), ("one_leg", "low")])
def test_honest_recordings_are_believed(task: str, randomness: str):
    log = next(log for log in recordings(task, randomness, range(5), scripted_operators()) if log.success)
    ClaimChecker(task).check(log)


@pytest.mark.slow
def test_honest_recordings_of_four_legs_are_believed():
    log = next(log for log in recordings("square_table", "low", range(5), scripted_operators()) if log.success)
    assert log.steps["reward"].sum() == 4
    ClaimChecker("square_table").check(log)
