"""Scenes under a shift: what differs, what does not, and that their states say so."""

from __future__ import annotations

import copy
import pickle

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray

from juicer.errors import ConfigError, InvalidEpisode
from juicer.seeding import stream
from juicer.shifts import Outside
from juicer.sim.env import AssemblyEnv
from juicer.sim.initial_states import initial_part_poses
from juicer.sim.registration import environment_id
from juicer.sim.vector import AssemblyVectorEnv
from juicer.tasks.registry import TASK_NAMES, get_task
from juicer.tasks.specification import Randomness

SOON = {"kind": "push", "earliest": 0.003, "latest": 0.003}
"""A push before the fourth of a thousand steps."""


def stay(env: AssemblyEnv) -> NDArray[np.float32]:
    """The action that leaves the gripper where it is, open."""
    seen = env.observation()["proprioception"]
    return np.append(seen[:9], np.float32(-1)).astype(np.float32)


def moved(env: AssemblyEnv, seed: int, steps: int) -> NDArray[np.float64]:
    """How far each part is from where it was reset, after some steps without a motion."""
    env.reset(seed=seed)
    before = env.observation()["part_poses"].reshape(-1, 7)[:, :3]
    action = stay(env)
    for _ in range(steps):
        env.step(action)
    after = env.observation()["part_poses"].reshape(-1, 7)[:, :3]
    return np.linalg.norm(after - before, axis=1)


@pytest.mark.parametrize("level", [Randomness.LOW, Randomness.MED])
@pytest.mark.parametrize("task_name", TASK_NAMES)
def test_one_part_that_matters_starts_outside_and_all_others_inside(task_name: str, level: Randomness):
    task = get_task(task_name)
    reach_m, reach_rad = {Randomness.LOW: (0.015, np.radians(15)), Randomness.MED: (0.05, np.radians(45))}[level]
    for seed in range(3):
        poses = initial_part_poses(task, level, stream(seed, "initial_state"), Outside())
        again = initial_part_poses(task, level, stream(seed, "initial_state"), Outside())
        np.testing.assert_array_equal(poses, again)
        astray = []
        for number, part in enumerate(task.parts):
            low, high = part.start_shift_m or (-reach_m, reach_m)
            shift = poses[number, :2] - part.start[:2]
            turn = 2 * np.arccos(min(1.0, abs(float(np.dot(poses[number, 3:], part.start[3:])))))
            if (shift < low - 1e-9).any() or (shift > high + 1e-9).any() or turn > reach_rad + 1e-6:
                astray.append(number)
        assert len(astray) == 1
        assert astray[0] in task.assembled_parts


def test_no_state_is_outside_of_stored_layouts():
    with pytest.raises(ConfigError, match="take low or med"):
        AssemblyEnv("one_leg", "high", shift="outside")


def test_a_push_moves_one_part_that_matters_once():
    env, plain = AssemblyEnv("one_leg", shift=SOON), AssemblyEnv("one_leg")
    for seed in range(3):
        assert (moved(plain, seed, 5) < 1e-3).all()
        assert (moved(env, seed, 3) < 1e-3).all()
        distances = moved(env, seed, 12)
        pushed = np.flatnonzero(distances > 0.005)
        assert len(pushed) == 1
        assert pushed[0] in env.task.assembled_parts
        assert 0.005 < distances[pushed[0]] < 0.15
        assert not env.data.xfrc_applied.any()


def test_what_the_gripper_holds_is_pushed_with_a_force():
    from tests.sim.conftest import PartOverHole

    held = PartOverHole("one_leg", 0, 0.0, 0.05).env
    env = AssemblyEnv("one_leg", shift={**SOON, "force_n": 7.0})
    env.reset(seed=0)
    env.data.qpos[:], env.data.ctrl[:] = held.data.qpos, held.data.ctrl
    action = np.append(held.observation()["proprioception"][:9], np.float32(1)).astype(np.float32)
    for _ in range(4):
        env.step(action)
    leg = env.model.body("square_table_leg4").id
    assert np.linalg.norm(env.data.xfrc_applied[leg]) == pytest.approx(7.0)
    assert not np.delete(env.data.xfrc_applied, leg, axis=0).any()


def test_things_slide_farther_where_they_rub_less():
    def distance(factor: float) -> float:
        env = AssemblyEnv("one_leg", shift={"kind": "friction", "factor": factor})
        env.reset(seed=0)
        action, leg = stay(env), env.model.body("square_table_leg1").id
        before = env.data.xpos[leg].copy()
        env.data.xfrc_applied[leg, 0] = -0.1
        env.step(action)
        env.data.xfrc_applied[:] = 0
        for _ in range(8):
            env.step(action)
        return float(np.linalg.norm(env.data.xpos[leg] - before))

    assert distance(0.5) > 1.3 * distance(1.0) > 0


def test_friction_concerns_no_other_environment():
    factor = AssemblyEnv("lamp", shift={"kind": "friction", "factor": 0.5}).model.geom_friction
    np.testing.assert_array_equal(factor, 0.5 * AssemblyEnv("lamp").model.geom_friction)


@pytest.mark.parametrize("kind", ["light", "camera"])
def test_the_physics_is_the_same_to_the_last_bit_where_only_images_differ(kind: str):
    env, plain = AssemblyEnv("one_leg", shift=kind), AssemblyEnv("one_leg")
    for each in (env, plain):
        each.reset(seed=1)
        for _ in range(3):
            each.step(stay(each))
    np.testing.assert_array_equal(env.get_state()[:-2], plain.get_state())


@pytest.mark.parametrize("begin", [2, 4, 5, 9])
def test_a_restored_state_goes_on_bit_for_bit_before_during_and_after_the_push(begin: int):
    env = AssemblyEnv("one_leg", shift=SOON)
    env.reset(seed=2)
    action, states = stay(env), []
    for _ in range(12):
        states.append(env.get_state())
        env.step(action)
    fresh = AssemblyEnv("one_leg", shift=SOON)
    fresh.set_state(states[begin])
    for expected in states[begin:]:
        np.testing.assert_array_equal(fresh.get_state(), expected)
        fresh.step(action)
    for twin in (copy.deepcopy(env), pickle.loads(pickle.dumps(env))):
        np.testing.assert_array_equal(twin.get_state(), env.get_state())


def test_a_state_goes_on_only_under_its_own_shift():
    env = AssemblyEnv("one_leg", shift={"kind": "friction", "factor": 0.5})
    env.reset(seed=0)
    state = env.get_state()
    plain = AssemblyEnv("one_leg")
    plain.reset(seed=0)
    before = plain.get_state()
    with pytest.raises(InvalidEpisode, match="of an environment under a shift, and goes on only there"):
        plain.set_state(state)
    np.testing.assert_array_equal(plain.get_state(), before)
    for other in ({"kind": "friction", "factor": 0.6}, "push"):
        with pytest.raises(InvalidEpisode, match="no simulator state of an environment under the shift"):
            AssemblyEnv("one_leg", shift=other).set_state(state)
    for wrong in (
        before,
        [1.0, 2.0],
        np.zeros(2),
        state[:-1],
        np.append(state[:-1], 0.5),
        np.append(state[:-1], 1e300),
    ):
        with pytest.raises(InvalidEpisode):
            env.set_state(wrong)
    np.testing.assert_array_equal(env.get_state(), state)


def test_gymnasium_makes_scenes_under_a_shift():
    env = gymnasium.make(environment_id("one_leg"), shift={"kind": "friction", "factor": 2.0})
    again = gymnasium.make(env.spec)
    assert env.unwrapped.shift == again.unwrapped.shift
    many = AssemblyVectorEnv(2, shift="push")
    assert [each.shift.shift.kind for each in many.envs] == ["push", "push"]
    with pytest.raises(ConfigError, match="did you mean 'push'"):
        AssemblyEnv("one_leg", shift="pusch")
