"""Seeds, options and settings of environments: applied as Gymnasium applies them, or refused in a sentence."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from juicer.errors import ConfigError, InvalidAction
from juicer.sim.env import AssemblyEnv
from juicer.sim.registration import environment_id
from juicer.sim.vector import AssemblyVectorEnv

ACTION = np.array([0.5, 0.15, 0.02, 0, 1, 0, 1, 0, 0, 1], dtype=np.float32)
ACTIONS = np.tile(ACTION, (2, 1))
NO_SEEDS = [True, np.bool_(True), -1, np.int64(-3), 1.0, np.float64(2), "3", b"3", [1], (1, 2), {}, np.array([1]), 1j]


@pytest.fixture
def envs():
    envs = AssemblyVectorEnv(2)
    yield envs
    envs.close()


def poses(seed: int) -> np.ndarray:
    return AssemblyEnv().reset(seed=seed)[0]["part_poses"]


@pytest.mark.parametrize("seed", [7, np.int64(7), np.uint8(7), np.array(7), 7 + 2**70, 10**4000])
def test_every_whole_number_is_a_seed_and_is_applied(seed: Any, envs: AssemblyVectorEnv):
    env = AssemblyEnv()
    observation, _ = env.reset(seed=seed)
    np.testing.assert_array_equal(observation["part_poses"], poses(int(seed)))
    assert env.np_random_seed == int(seed)
    together, _ = envs.reset(seed=seed)
    np.testing.assert_array_equal(together["part_poses"], [poses(int(seed)), poses(int(seed) + 1)])
    assert envs.np_random_seed == (int(seed), int(seed) + 1)


@pytest.mark.parametrize("seed", NO_SEEDS, ids=repr)
def test_what_is_no_seed_is_refused_and_nothing_is_reset(seed: Any, envs: AssemblyVectorEnv):
    env = AssemblyEnv()
    env.reset(seed=1)
    envs.reset(seed=1)
    states = [each.get_state() for each in (env, *envs.envs)]
    with pytest.raises(ConfigError, match="a seed must be a whole number"):
        env.reset(seed=seed)
    for row in ([seed, 1], (None, seed)):
        with pytest.raises(ConfigError, match="a seed must be a whole number"):
            envs.reset(seed=row)
    for each, state in zip((env, *envs.envs), states, strict=True):
        np.testing.assert_array_equal(each.get_state(), state)


@pytest.mark.parametrize("seed", [True, -1, 1.5, "12", b"12", {4: 1, 9: 2}, {4, 9}, np.array(1.0)], ids=repr)
def test_many_environments_refuse_what_one_refuses(seed: Any, envs: AssemblyVectorEnv):
    with pytest.raises(ConfigError, match="a seed must be a whole number"):
        envs.reset(seed=seed)


@pytest.mark.parametrize("seeds", [[4, 9], (4, 9), np.array([4, 9]), np.array([4, 9], np.uint8), [np.int64(4), 9]])
def test_a_sequence_seeds_each_environment(seeds: Any, envs: AssemblyVectorEnv):
    observation, _ = envs.reset(seed=seeds)
    np.testing.assert_array_equal(observation["part_poses"], [poses(4), poses(9)])


@pytest.mark.parametrize("seeds", [[], (), np.array([], int), [1], [1, 2, 3], np.arange(3), range(5)], ids=repr)
def test_a_sequence_of_another_length_is_refused(seeds: Any, envs: AssemblyVectorEnv):
    with pytest.raises(ConfigError, match=r"one for each of the 2 environments, got \d"):
        envs.reset(seed=seeds)


def test_an_environment_without_a_seed_goes_on_with_its_own_random_numbers(envs: AssemblyVectorEnv):
    envs.reset(seed=[4, 9])
    observation, _ = envs.reset(seed=[None, 5])
    alone = AssemblyEnv()
    alone.reset(seed=4)
    np.testing.assert_array_equal(observation["part_poses"][0], alone.reset()[0]["part_poses"])
    np.testing.assert_array_equal(observation["part_poses"][1], poses(5))


def test_resets_without_a_seed_repeat_after_the_same_first_seed(envs: AssemblyVectorEnv):
    env, again = AssemblyEnv(), AssemblyEnv()
    drawn = []
    for each in (env, again):
        each.reset(seed=0)
        drawn.append([each.reset()[0]["part_poses"] for _ in range(3)])
    np.testing.assert_array_equal(drawn[0], drawn[1])
    assert not np.array_equal(drawn[0][0], drawn[0][1])
    envs.reset(seed=0)
    np.testing.assert_array_equal(envs.reset()[0]["part_poses"][0], drawn[0][0])
    assert env.np_random_seed == 0


@pytest.mark.parametrize(
    "mask",
    [[True, False], (True, False), np.array([1, 0]), np.array([True]), np.array([[True, False]]), True, "10",
     np.array([True, False, True]), np.array([0.0, 1.0]), np.array([True, None])],
    ids=repr,
)  # fmt: skip
def test_a_mask_must_be_an_array_of_truth_values_one_an_environment(mask: Any, envs: AssemblyVectorEnv):
    envs.reset(seed=1)
    states = [env.get_state() for env in envs.envs]
    with pytest.raises(ConfigError, match=r"must be a boolean numpy array of shape \(2,\), got"):
        envs.reset(seed=3, options={"reset_mask": mask})
    for env, state in zip(envs.envs, states, strict=True):
        np.testing.assert_array_equal(env.get_state(), state)


def test_a_mask_that_names_nothing_or_leaves_out_what_never_began_is_refused(envs: AssemblyVectorEnv):
    with pytest.raises(ConfigError, match="environment 1 was never reset"):
        envs.reset(seed=3, options={"reset_mask": np.array([True, False])})
    assert not envs.envs[0].has_begun
    with pytest.raises(ConfigError, match="at least one environment"):
        envs.reset(seed=3, options={"reset_mask": np.array([False, False])})


def test_options_are_neither_changed_nor_ignored(envs: AssemblyVectorEnv):
    envs.reset(seed=0)
    options = {"reset_mask": np.array([True, False])}
    envs.reset(seed=3, options=options)
    assert list(options) == ["reset_mask"]
    for env in (envs, AssemblyEnv()):
        env.reset(seed=3, options={})
        with pytest.raises(ConfigError, match="no option 'colour'"):
            env.reset(seed=3, options={"colour": 3})
        with pytest.raises(ConfigError, match="must be a dictionary or None"):
            env.reset(seed=3, options=[1])


def test_a_step_needs_a_state_to_start_from(envs: AssemblyVectorEnv):
    env = AssemblyEnv()
    with pytest.raises(InvalidAction, match=r"call reset\(\) first"):
        env.step(ACTION)
    with pytest.raises(InvalidAction, match=r"call reset\(\) first"):
        env.render()
    with pytest.raises(InvalidAction, match="environment 0 was never reset"):
        envs.step(ACTIONS)
    state = AssemblyEnv()
    state.reset(seed=0)
    env.set_state(state.get_state())
    env.step(ACTION)


@pytest.mark.parametrize(
    ("actions", "problem"),
    [
        (ACTION, r"shape \(2, 10\), got \(10,\)"),
        (ACTIONS[:1], r"got \(1, 10\)"),
        (np.tile(ACTION, (3, 1)), r"got \(3, 10\)"),
        (ACTIONS[:, :9], r"got \(2, 9\)"),
        ([ACTION, ACTION[:3]], "cannot be read as an array"),
        (np.stack([ACTION, np.full(10, np.nan)]), "environment 1: .*finite"),
        (np.stack([ACTION, np.full(10, 1e300)]), "environment 1: .*finite"),
        (np.stack([ACTION, 3 * ACTION]), "environment 1: .*within"),
        (np.stack([ACTION, np.zeros(10)]), "environment 1: .*degenerate"),
        (ACTIONS.astype(str), "real numbers"),
        (ACTIONS.astype(complex), "real numbers"),
        (ACTIONS.astype(bool), "real numbers"),
        (ACTIONS.astype(object), "real numbers"),
        (None, "real numbers"),
    ],
)
def test_an_invalid_row_moves_no_environment(actions: Any, problem: str, envs: AssemblyVectorEnv):
    envs.reset(seed=0)
    states = [env.get_state() for env in envs.envs]
    with pytest.raises(InvalidAction, match=problem):
        envs.step(actions)
    for env, state in zip(envs.envs, states, strict=True):
        np.testing.assert_array_equal(env.get_state(), state)


@pytest.mark.parametrize(
    "action", [ACTION.astype(str), ACTION.astype(complex), ACTION > 0, None, [[1], [2, 3]], {"a": 1}, "close"]
)
def test_an_action_that_is_no_array_of_numbers_is_refused(action: Any):
    env = AssemblyEnv()
    env.reset(seed=0)
    before = env.get_state()
    with pytest.raises(InvalidAction, match="an action"):
        env.step(action)
    np.testing.assert_array_equal(env.get_state(), before)


def test_an_ended_episode_is_not_stepped_on_beside_others():
    envs = AssemblyVectorEnv(2, max_steps=2)
    envs.reset(seed=0)
    envs.step(ACTIONS)
    envs.reset(options={"reset_mask": np.array([True, False])})
    *_, truncations, infos = envs.step(ACTIONS)
    assert truncations.tolist() == [False, True]
    assert infos["outcome"][1] == "timeout"
    with pytest.raises(InvalidAction, match="episode of environment 1 has ended with 'timeout'"):
        envs.step(ACTIONS)
    envs.reset(options={"reset_mask": truncations})
    envs.step(ACTIONS)
    envs.close()
    with pytest.raises(ConfigError, match="were closed"):
        envs.step(ACTIONS)


@pytest.mark.parametrize("number", [0, -1, 1.5, True, "3", np.float32(2)], ids=repr)
def test_numbers_of_environments_threads_and_steps_are_positive(number: Any):
    with pytest.raises(ConfigError, match="max_steps must be a whole number of at least 1"):
        AssemblyEnv(max_steps=number)
    for name in ("num_envs", "num_threads"):
        with pytest.raises(ConfigError, match=f"{name} must be a whole number"):
            AssemblyVectorEnv(**({"num_envs": 1} | {name: number}))


@pytest.mark.parametrize("mode", ["human", "rgb", 3])
def test_an_unknown_render_mode_is_refused(mode: Any):
    with pytest.raises(ConfigError, match=r"unknown render_mode .*'rgb_array'"):
        AssemblyEnv(render_mode=mode)


@pytest.mark.parametrize("name", [None, 3, ["one_leg"], "", "one_leg\x1b[2J"], ids=repr)
def test_what_is_no_name_of_a_task_or_a_randomness_is_refused(name: Any):
    with pytest.raises(ConfigError, match="unknown task '") as caught:
        AssemblyEnv(name)
    assert "\x1b" not in str(caught.value)
    with pytest.raises(ConfigError, match="unknown randomness '"):
        AssemblyEnv(randomness=name)


def test_gymnasiums_limit_of_steps_is_ours():
    envs = gymnasium.make_vec(environment_id("one_leg"), num_envs=2, max_episode_steps=1)
    envs.reset(seed=0)
    assert envs.step(ACTIONS)[3].all()
    envs.close()


def test_gymnasium_accepts_the_environment_with_its_pictures():
    check_env(AssemblyEnv(render_mode="rgb_array"))


def test_a_vector_environment_gives_what_its_spaces_say(envs: AssemblyVectorEnv):
    observation, infos = envs.reset(seed=0)
    assert observation in envs.observation_space
    observation, rewards, terminations, truncations, infos = envs.step(ACTIONS)
    assert observation in envs.observation_space
    assert (rewards.shape, rewards.dtype) == ((2,), np.float64)
    assert terminations.dtype == truncations.dtype == np.bool_
    assert infos["parts_assembled"].tolist() == [0, 0]
    kept = {name: values.copy() for name, values in observation.items()}
    envs.step(ACTIONS)
    for name, values in kept.items():
        np.testing.assert_array_equal(observation[name], values)
    assert envs.get_attr("max_steps") == (1000, 1000)
