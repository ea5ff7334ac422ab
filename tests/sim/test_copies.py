"""A copy of an environment is an environment of its own that goes on exactly where the original is."""

from __future__ import annotations

import copy
import multiprocessing
import pickle
from collections.abc import Callable
from typing import Any

import cloudpickle
import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray

from juicer.expert.operator import ScriptedOperator
from juicer.seeding import stream
from juicer.sim.controller import EndEffectorController
from juicer.sim.env import AssemblyEnv
from juicer.sim.registration import environment_id
from juicer.sim.vector import AssemblyVectorEnv
from juicer.tasks.registry import TASK_NAMES, get_task

MEANS: dict[str, Callable[[Any], Any]] = {
    "copy.copy": copy.copy,
    "copy.deepcopy": copy.deepcopy,
    "pickle": lambda env: pickle.loads(pickle.dumps(env)),
    "oldest pickle that keeps arrays": lambda env: pickle.loads(pickle.dumps(env, protocol=2)),
    "cloudpickle": lambda env: cloudpickle.loads(cloudpickle.dumps(env)),
    "a copy of a copy": lambda env: copy.copy(pickle.loads(pickle.dumps(env))),
}
MEANS_OF_COPYING = pytest.mark.parametrize("make_copy", MEANS.values(), ids=MEANS)


class Working:
    """An environment with the scripted operator at work in it."""

    def __init__(self, task: str = "one_leg", steps: int = 130) -> None:
        self.env = AssemblyEnv(task)
        self.observation, _ = self.env.reset(seed=0)
        self.operator = ScriptedOperator(self.env.task, stream(0, "operator", 0))
        for _ in range(steps):
            self.observation, *_ = self.env.step(self.action())

    def action(self) -> NDArray[np.floating[Any]]:
        return self.operator.act(self.observation).action


def assert_same_future(first: AssemblyEnv, second: AssemblyEnv, actions: list[NDArray[Any]]) -> None:
    assert first.contact_pairs() == second.contact_pairs()
    for action in actions:
        (seen, *rest), (also_seen, *also_rest) = first.step(action), second.step(action)
        assert rest == also_rest
        for name, values in seen.items():
            np.testing.assert_array_equal(values, also_seen[name])
        np.testing.assert_array_equal(first.get_state(), second.get_state())


@MEANS_OF_COPYING
def test_a_copy_made_while_a_part_is_held_goes_on_bit_for_bit(make_copy: Callable[[Any], Any]):
    working = Working()
    assert working.env.contact_pairs()
    twin = make_copy(working.env)
    assert_same_future(working.env, twin, [working.action()] * 20)
    for seed in (3, None, None):
        working.env.reset(seed=seed)
        twin.reset(seed=seed)
        np.testing.assert_array_equal(working.env.get_state(), twin.get_state())
    assert_same_future(working.env, twin, [working.action()] * 3)


@pytest.mark.parametrize("task", TASK_NAMES)
def test_every_task_can_be_copied(task: str):
    working = Working(task, steps=60)
    assert_same_future(working.env, pickle.loads(pickle.dumps(working.env)), [working.action()] * 5)


@MEANS_OF_COPYING
def test_original_and_copy_do_not_disturb_each_other(make_copy: Callable[[Any], Any]):
    working = Working(steps=5)
    twin = make_copy(working.env)
    before = twin.get_state()
    working.env.step(working.action())
    working.env.np_random.random()
    working.env.model.body_mass[:] *= 5
    working.env.metadata["render_fps"] = 1
    np.testing.assert_array_equal(twin.get_state(), before)
    untouched = AssemblyEnv()
    untouched.reset(seed=0)
    assert twin.np_random.random() == untouched.np_random.random()
    np.testing.assert_array_equal(twin.model.body_mass, untouched.model.body_mass)
    assert twin.metadata == untouched.metadata


@MEANS_OF_COPYING
def test_a_copy_keeps_limits_settings_and_a_changed_model(make_copy: Callable[[Any], Any]):
    env = AssemblyEnv("lamp", "med", render_mode="rgb_array", max_steps=3)
    env.reset(seed=4)
    env.model.body_mass[:] *= 2
    env.note = "mine"
    twin = make_copy(env)
    assert (twin.task.name, twin.randomness, twin.render_mode, twin.max_steps) == ("lamp", "med", "rgb_array", 3)
    assert twin.note == "mine"
    assert twin.data.model is twin.model
    np.testing.assert_array_equal(twin.model.body_mass, env.model.body_mass)
    assert_same_future(env, twin, [Working(steps=0).action()] * 3)
    assert twin.outcome == "timeout"


@MEANS_OF_COPYING
def test_what_has_not_begun_or_has_diverged_can_be_copied_too(make_copy: Callable[[Any], Any]):
    env = AssemblyEnv()
    assert not make_copy(env).has_begun
    env.reset(seed=0)
    env.data.qvel[12] = np.nan
    env.step(Working(steps=0).action())
    twin = make_copy(env)
    assert twin.outcome == "diverged"
    np.testing.assert_array_equal(twin.get_state(), env.get_state())


@pytest.mark.parametrize("means", ["copy.deepcopy", "pickle", "cloudpickle"])
def test_gymnasium_wrappers_take_their_environment_along(means: str):
    env = gymnasium.make(environment_id("one_leg"), max_episode_steps=2)
    env.reset(seed=0)
    action = Working(steps=0).action().astype(np.float32)
    env.step(action)
    twin = MEANS[means](env)
    assert env.step(action)[3] is twin.step(action)[3] is True
    np.testing.assert_array_equal(env.unwrapped.get_state(), twin.unwrapped.get_state())
    np.testing.assert_array_equal(env.reset()[0]["part_poses"], twin.reset()[0]["part_poses"])


def test_an_environment_made_from_another_ones_spec_has_its_settings():
    env = gymnasium.make(environment_id("round_table"), randomness="high", max_steps=7)
    for spec in (env.spec, gymnasium.envs.registration.EnvSpec.from_json(env.spec.to_json())):
        again = gymnasium.make(spec)
        for each in (env, again):
            each.reset(seed=2)
        np.testing.assert_array_equal(env.unwrapped.get_state(), again.unwrapped.get_state())
        assert again.unwrapped.max_steps == 7


@MEANS_OF_COPYING
def test_a_copied_vector_environment_goes_on_bit_for_bit(make_copy: Callable[[Any], Any]):
    envs = AssemblyVectorEnv(2, randomness="med", max_steps=9)
    envs.reset(seed=5)
    actions = np.tile(Working(steps=0).action().astype(np.float32), (2, 1))
    envs.step(actions)
    twin = make_copy(envs)
    for _ in range(3):
        assert_equal_steps(envs.step(actions), twin.step(actions))
    for first, second in zip(envs.envs, twin.envs, strict=True):
        assert first is not second
        np.testing.assert_array_equal(first.get_state(), second.get_state())
    np.testing.assert_array_equal(envs.reset()[0]["part_poses"], twin.reset()[0]["part_poses"])
    envs.close()
    twin.step(actions)
    twin.close()


def assert_equal_steps(first: Any, second: Any) -> None:
    for name, values in first[0].items():
        np.testing.assert_array_equal(values, second[0][name])
    for values, others in zip(first[1:4], second[1:4], strict=True):
        np.testing.assert_array_equal(values, others)


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_other_processes_continue_what_they_are_handed(method: str):
    envs = AssemblyVectorEnv(2)
    envs.reset(seed=5)
    actions = np.tile(Working(steps=0).action().astype(np.float32), (2, 1))
    envs.step(actions)
    context = multiprocessing.get_context(method)
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=step_elsewhere, args=(envs, actions, sender))
    process.start()
    assert receiver.poll(60)
    states = receiver.recv()
    process.join()
    envs.step(actions)
    for state, env in zip(states, envs.envs, strict=True):
        np.testing.assert_array_equal(state, env.get_state())
    envs.close()


def step_elsewhere(envs: AssemblyVectorEnv, actions: NDArray[np.float32], sender: Any) -> None:
    envs.step(actions)
    sender.send([env.get_state() for env in envs.envs])


def test_gymnasiums_own_vector_environments_agree_with_ours():
    settings: dict[str, Any] = {"num_envs": 2, "randomness": "high", "max_steps": 50}
    ours = gymnasium.make_vec(environment_id("one_leg"), **settings)
    actions = np.tile(Working(steps=0).action().astype(np.float32), (2, 1))
    for mode in ("sync", "async"):
        theirs = gymnasium.make_vec(environment_id("one_leg"), vectorization_mode=mode, **settings)
        for seed in (3, [8, 2]):
            (first, _), (second, _) = ours.reset(seed=seed), theirs.reset(seed=seed)
            np.testing.assert_array_equal(first["part_poses"], second["part_poses"])
            assert_equal_steps(ours.step(actions), theirs.step(actions))
        theirs.close()
    ours.close()


@pytest.mark.parametrize("make_copy", [copy.copy, copy.deepcopy, MEANS["pickle"]])
def test_a_copied_controller_solves_for_the_same_joints(make_copy: Callable[[Any], Any]):
    controller, joints = EndEffectorController(), Working(steps=0).env.data.qpos[:7].copy()
    goal = np.array([0.5, 0.1, 0.1, 0, 1, 0, 1, 0, 0, -1.0])
    twin = make_copy(controller)
    np.testing.assert_array_equal(twin.joint_targets(goal, joints), controller.joint_targets(goal, joints))


def test_what_is_changed_in_one_model_changes_no_other_environment():
    env, other = AssemblyEnv(), AssemblyEnv()
    masses = other.model.body_mass.copy()
    env.model.body_mass[:] *= 5
    env.model.opt.gravity[:] = 0
    for each in (other, AssemblyEnv(), AssemblyVectorEnv(2).envs[1]):
        np.testing.assert_array_equal(each.model.body_mass, masses)
        assert each.model.opt.gravity[2] == pytest.approx(-9.8)


def test_nothing_that_is_handed_out_leads_back_inside():
    env, undisturbed = AssemblyEnv(), AssemblyEnv()
    for each in (env, undisturbed):
        each.reset(seed=0)
    action = Working(steps=0).action()
    observation, _, _, _, info = env.step(action)
    undisturbed.step(action)
    for array in (*observation.values(), env.get_state(), action):
        array[...] = 0
    info["milestones"]["done"] = 1
    np.testing.assert_array_equal(env.get_state(), undisturbed.get_state())
    assert "done" not in env._info()["milestones"]


def test_tasks_cannot_be_changed():
    def parts_of(value: object) -> list[object]:
        if isinstance(value, tuple):
            return [value, *(inner for item in value for inner in parts_of(item))]
        fields = getattr(value, "__dataclass_fields__", {})
        return [value, *(inner for name in fields for inner in parts_of(getattr(value, name)))]

    for name in TASK_NAMES:
        assert not any(isinstance(part, dict | list | set | np.ndarray) for part in parts_of(get_task(name)))
