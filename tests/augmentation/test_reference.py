from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from juicer.augmentation.reference import reference_of
from juicer.episode import STATE_KEY, Episode


def with_gripper(episode: Episode, commands: Sequence[float]) -> Episode:
    action = episode.steps["action"].copy()
    action[:, 9] = commands
    return Episode(episode.record, {**episode.steps, "action": action}, episode.final)


def test_a_reference_runs_until_some_steps_after_the_next_gripper_change(episode_factory: Callable[..., Episode]):
    demonstration = with_gripper(episode_factory(20, seed=4), [1.0] * 8 + [-1.0] * 12)
    reference = reference_of(demonstration, 3, 0, steps_after_gripper_change=5)
    np.testing.assert_array_equal(reference.actions, demonstration.steps["action"][3:13])
    np.testing.assert_array_equal(reference.change.part_poses, demonstration.steps["part_poses"][8])
    np.testing.assert_array_equal(reference.end.part_poses, demonstration.steps["part_poses"][13])
    assert (reference.change.remaining, reference.end.remaining) == (5, 0)
    np.testing.assert_array_equal(reference.state, demonstration.steps[STATE_KEY][3])
    np.testing.assert_array_equal(reference.pose, demonstration.steps["proprioception"][3, :9])
    assert reference.gripper == 1.0
    assert (reference.parent, reference.seed, reference.critical_state) == (demonstration.record.episode_id, 4, 0)


def test_a_reference_ends_with_its_demonstration(episode_factory: Callable[..., Episode]):
    for commands in ([1.0] * 18 + [-1.0] * 2, [1.0] * 20):
        demonstration = with_gripper(episode_factory(20), commands)
        reference = reference_of(demonstration, 3, 0, steps_after_gripper_change=5)
        assert len(reference.actions) == 17
        np.testing.assert_array_equal(reference.end.part_poses, demonstration.final["part_poses"])
        assert reference.end.remaining == 0


def test_a_command_that_keeps_the_gripper_is_spelt_out(episode_factory: Callable[..., Episode]):
    demonstration = with_gripper(episode_factory(20), [1.0] + [0.0] * 9 + [-1.0] * 10)
    assert reference_of(demonstration, 3, 0, steps_after_gripper_change=5).gripper == 1.0


@pytest.mark.parametrize(
    ("commands", "begin"),
    [
        pytest.param([-1.0] * 17 + [1.0] * 13, 2, id="fifteen steps before it"),
        pytest.param([-1.0] * 6 + [1.0] * 24, 0, id="from the start"),
        pytest.param([-1.0] * 8 + [1.0] * 8 + [-1.0] * 4 + [1.0] * 10, 16, id="not while another grasp lasts"),
    ],
)
def test_the_way_to_a_grasp_begins(episode_factory: Callable[..., Episode], commands: Sequence[float], begin: int):
    demonstration = with_gripper(episode_factory(30), commands)
    grasp = reference_of(demonstration, 25, 0, steps_after_gripper_change=5).grasp
    assert grasp is not None
    np.testing.assert_array_equal(grasp.state, demonstration.steps[STATE_KEY][begin])
    np.testing.assert_array_equal(grasp.actions, demonstration.steps["action"][begin:25])


@pytest.mark.parametrize("commands", [[1.0] * 30, [1.0] * 10 + [-1.0] * 20])
def test_there_is_no_way_to_a_grasp(episode_factory: Callable[..., Episode], commands: Sequence[float]):
    demonstration = with_gripper(episode_factory(30), commands)
    assert reference_of(demonstration, 25, 0, steps_after_gripper_change=5).grasp is None
