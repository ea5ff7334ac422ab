from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from juicer.augmentation.config import FAR, NEAR, AugmentationConfig
from juicer.augmentation.execute import execute, reproduces
from juicer.augmentation.plan import plan_departure
from juicer.augmentation.reference import Reference
from juicer.augmentation.verify import RejectionReason, deviation_from_reference
from juicer.episode import STATE_KEY, Episode, Outcome, Source
from juicer.seeding import stream
from juicer.sim.env import AssemblyEnv

AT_ONCE = np.empty((0, 9))


def departure(reference: Reference, seed: int = 0) -> NDArray[np.float64]:
    return plan_departure(reference.pose, FAR, stream(seed, "test"))


def test_without_a_departure_the_demonstration_itself_is_replayed_exactly(env: AssemblyEnv, reference: Reference):
    snippet = execute(env, reference, AT_ONCE)
    assert isinstance(snippet, Episode)
    np.testing.assert_array_equal(snippet.final["part_poses"], reference.end.part_poses)


def test_a_snippet_returns_to_the_critical_pose_and_joins_the_demonstration(env: AssemblyEnv, reference: Reference):
    away = departure(reference)
    snippet = execute(env, reference, away)
    assert isinstance(snippet, Episode)
    back = len(away)
    assert len(snippet) == back + len(reference.actions)
    np.testing.assert_array_equal(snippet.steps["action"][back:], reference.actions)
    np.testing.assert_array_equal(snippet.steps["action"][back - 1, :9], reference.pose)
    reached = snippet.steps["proprioception"][back, :3]
    assert np.linalg.norm(reached - reference.pose[:3]) < 0.01
    assert np.linalg.norm(snippet.steps["proprioception"][0, :3] - reference.pose[:3]) > 0.02
    assert deviation_from_reference(snippet, reference, AugmentationConfig()) is None


def test_a_snippet_says_where_it_comes_from(env: AssemblyEnv, reference: Reference):
    snippet = execute(env, reference, AT_ONCE)
    assert isinstance(snippet, Episode)
    record = snippet.record
    assert (record.source, record.outcome) == (Source.AUGMENTATION, Outcome.SUCCESS)
    assert (record.parent, record.critical_state, record.seed) == (reference.parent, 0, 0)


def test_a_snippet_replays_in_another_environment(env: AssemblyEnv, reference: Reference):
    snippet = execute(env, reference, departure(reference))
    assert isinstance(snippet, Episode)
    assert reproduces(AssemblyEnv("one_leg", max_steps=100_000), snippet)


def test_an_action_that_was_not_executed_does_not_reproduce(env: AssemblyEnv, reference: Reference):
    snippet = execute(env, reference, AT_ONCE)
    assert isinstance(snippet, Episode)
    action = snippet.steps["action"].copy()
    action[4, 0] += 1e-6
    assert not reproduces(env, replace(snippet, steps={**snippet.steps, "action": action}))


def test_a_part_that_slips_out_of_the_hand_on_the_way_is_noticed(env: AssemblyEnv, reference: Reference):
    opening = replace(reference, gripper=-1.0)
    away = plan_departure(reference.pose, NEAR, stream(0, "test"))
    assert execute(env, opening, away) is RejectionReason.DROPPED


@pytest.mark.parametrize("outcome", [Outcome.DIVERGED, Outcome.PART_LOST])
def test_an_episode_that_ends_on_the_way_gives_no_snippet(
    reference: Reference, outcome: Outcome, monkeypatch: pytest.MonkeyPatch
):
    env = AssemblyEnv("one_leg")
    monkeypatch.setattr(env, "_outcome", lambda parts_assembled: outcome)
    assert execute(env, reference, departure(reference)) == outcome.value
    assert execute(env, reference, AT_ONCE) == outcome.value


def test_the_departure_is_not_recorded(env: AssemblyEnv, reference: Reference):
    away = departure(reference)
    snippet = execute(env, reference, away)
    assert isinstance(snippet, Episode)
    env.set_state(reference.state)
    for target in away:
        env.step(np.append(target, reference.gripper).astype(np.float32))
    np.testing.assert_array_equal(snippet.steps[STATE_KEY][0], env.get_state())
