"""Displaced states: what moves with what, and that labels are exact."""

from __future__ import annotations

import numpy as np
import pytest

from juicer.displacements import Displacements
from juicer.estimation.perturbation import Perturbation
from juicer.geometry import quat_to_matrix, relative_pose, rotation_angle
from juicer.seeding import stream
from juicer.sim.env import AssemblyEnv
from juicer.tasks.registry import TASK_NAMES

STILL = dict.fromkeys(Displacements.model_fields, 0.0)
TOP, LEG = 0, 4
HELD_STEP, INSERTED_STEP = 8, 34


def displaced(episode, step, task="one_leg", seed=0, **changes):
    perturbation = Perturbation(task, Displacements(**{**STILL, **changes}))
    return perturbation.displace(episode.state(step), stream(seed, "test"))


def poses(scene):
    return scene.part_poses.reshape(-1, 7).astype(float)


def distance_mm(first, second):
    return 1000 * float(np.linalg.norm(first[:3] - second[:3]))


def test_without_displacements_a_state_stays_as_it_was(insertions):
    episode = insertions[0]
    scene = displaced(episode, HELD_STEP)
    np.testing.assert_allclose(scene.part_poses, episode.steps["part_poses"][HELD_STEP], atol=1e-6)
    np.testing.assert_allclose(scene.proprioception[:9], episode.steps["proprioception"][HELD_STEP][:9], atol=2e-4)


def test_a_held_part_moves_with_the_gripper(insertions):
    episode = insertions[0]
    before, scene = displaced(episode, HELD_STEP), displaced(episode, HELD_STEP, gripper_m=0.05, gripper_rad=0.3)
    assert distance_mm(scene.proprioception.astype(float), before.proprioception.astype(float)) > 5
    as_before, as_now = (np.linalg.norm(poses(each)[LEG, :3] - each.proprioception[:3]) for each in (before, scene))
    assert as_now == pytest.approx(as_before, abs=1e-5)
    np.testing.assert_array_equal(poses(scene)[:LEG], poses(before)[:LEG])


def test_it_slips_a_little_in_the_gripper(insertions):
    before, scene = displaced(insertions[0], HELD_STEP), displaced(insertions[0], HELD_STEP, slip_m=0.01, seed=1)
    np.testing.assert_array_equal(scene.proprioception[:9], before.proprioception[:9])
    assert 0.1 < distance_mm(poses(scene)[LEG], poses(before)[LEG]) < 30


def test_what_stands_in_a_part_moves_along_with_it(insertions):
    before, scene = (
        displaced(insertions[0], INSERTED_STEP),
        displaced(insertions[0], INSERTED_STEP, base_m=0.05, base_rad=0.5),
    )
    assert distance_mm(poses(scene)[TOP], poses(before)[TOP]) > 5
    leg_in_top = [relative_pose(poses(each)[TOP], poses(each)[LEG]) for each in (before, scene)]
    np.testing.assert_allclose(*leg_in_top, atol=1e-5)


def test_parts_on_the_table_stay_on_it(insertions):
    before, scene = (
        displaced(insertions[0], HELD_STEP),
        displaced(insertions[0], HELD_STEP, base_m=0.05, base_rad=0.5, part_m=0.05, part_rad=0.5),
    )
    np.testing.assert_allclose(poses(scene)[:LEG, 2], poses(before)[:LEG, 2], atol=1e-6)
    up = [quat_to_matrix(poses(each)[:LEG, 3:])[:, 2] for each in (before, scene)]
    np.testing.assert_allclose(*up, atol=1e-5)
    turned = rotation_angle(*(quat_to_matrix(poses(each)[:LEG, 3:]) for each in (before, scene)))
    assert (turned > 1e-3).all()


def test_the_labels_are_those_of_the_scene_that_is_drawn(insertions):
    scene = displaced(insertions[0], HELD_STEP, **Displacements().model_dump())
    env = AssemblyEnv("one_leg")
    env.reset(seed=0)
    first = env.model.joint(env.task.parts[0].name).qposadr[0]
    np.testing.assert_array_equal(scene.positions[first : first + 35].astype(np.float32), scene.part_poses)


@pytest.mark.parametrize("task", TASK_NAMES)
def test_states_of_every_task_are_displaced(task):
    env = AssemblyEnv(task)
    env.reset(seed=0)
    perturbation = Perturbation(task, Displacements())
    first, again, other = (perturbation.displace(env.get_state(), stream(seed, "test")) for seed in (0, 0, 1))
    np.testing.assert_array_equal(first.positions, again.positions)
    assert not np.array_equal(first.part_poses, other.part_poses)
