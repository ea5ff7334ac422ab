import os
import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from juicer.episode import Outcome
from juicer.errors import ConfigError, InvalidAction, InvalidEpisode
from juicer.geometry import quat_to_matrix
from juicer.sim.env import AssemblyEnv
from juicer.sim.registration import environment_id
from juicer.tasks.registry import TASK_NAMES
from juicer.tasks.specification import TABLE_HEIGHT_M

REST = np.array([0.56, 0.05, 0.12, 0, 1, 0, 1, 0, 0, -1], dtype=np.float32)


@pytest.fixture
def env():
    env = AssemblyEnv()
    env.reset(seed=0)
    return env


def test_the_reset_pose_is_the_benchmarks(env):
    proprioception = env.observation()["proprioception"]
    np.testing.assert_allclose(proprioception[:3], [0.5673, 0.0554, 0.1239], atol=2e-4)
    np.testing.assert_allclose(proprioception[3:9], [0.5960, 0.8029, -0.0119, 0.8028, -0.5961, -0.0120], atol=2e-4)
    assert proprioception[15] == pytest.approx(0.065, abs=1e-3)


def test_a_step_lasts_a_tenth_of_a_second(env):
    before = env.data.time
    env.step(REST)
    assert env.data.time - before == pytest.approx(0.1)


def test_the_initial_state_depends_on_the_seed_alone(env):
    other = AssemblyEnv()
    for seed in (5, 6):
        env.reset(seed=seed)
        other.reset(seed=99)
        other.reset(seed=seed)
        np.testing.assert_array_equal(env.get_state(), other.get_state())
    assert not np.array_equal(env.reset(seed=5)[0]["part_poses"], env.reset(seed=6)[0]["part_poses"])


@pytest.mark.parametrize("task", TASK_NAMES)
@pytest.mark.parametrize("randomness", ["low", "med", "high"])
def test_parts_lie_on_the_table_and_never_start_assembled(task, randomness):
    env = AssemblyEnv(task, randomness)
    for seed in range(10):
        _, info = env.reset(seed=seed)
        heights = env.observation()["part_poses"].reshape(-1, 7)[:, 2]
        assert (heights > TABLE_HEIGHT_M).all()
        assert info["parts_assembled"] == 0
        assert info["milestones"] == {}


@pytest.mark.parametrize(
    ("action", "problem"),
    [
        (np.full(10, np.nan), "finite"),
        (np.where(np.arange(10) == 3, np.inf, REST), "finite"),
        (np.zeros(9), "shape"),
        (np.zeros((1, 10)), "shape"),
        (np.where(np.arange(10) == 0, 5.0, REST), "within"),
        (np.array([0.5, 0, 0.1, 0, 0, 0, 0, 0, 0, 1.0]), "degenerate"),
        (np.array([0.5, 0, 0.1, 1, 0, 0, 1, 0, 0, 1.0]), "parallel"),
    ],
)
def test_an_invalid_action_is_refused_before_anything_moves(env, action, problem):
    before = env.get_state()
    with pytest.raises(InvalidAction, match=problem):
        env.step(action)
    np.testing.assert_array_equal(env.get_state(), before)


def test_a_stored_float32_action_replays_what_a_float64_action_did(env):
    start = env.get_state()
    action = REST.astype(np.float64) + 1e-9
    env.step(action)
    first = env.get_state()
    env.set_state(start)
    env.step(action.astype(np.float32))
    np.testing.assert_array_equal(env.get_state(), first)


def test_a_small_gripper_command_keeps_the_last_one(env):
    for gripper in (1.0,) * 8 + (0.01,) * 8:
        observation, *_ = env.step(np.array([*REST[:9], gripper]))
    assert observation["proprioception"][15] < 0.005


def test_a_part_pushed_off_the_table_ends_the_episode(env):
    state = env.get_state()
    leg_x = 1 + 9 + 7 * 4
    state[leg_x : leg_x + 3] = [1.3, 0.0, 0.1]
    state[-len(env._progress) - env.model.ntree : -len(env._progress)] = -11
    env.set_state(state)
    for _ in range(10):
        *_, terminated, truncated, info = env.step(REST)
        if terminated:
            break
    assert info["outcome"] is Outcome.PART_LOST
    assert terminated
    assert not truncated


def test_divergence_is_an_outcome_of_its_own(env):
    env.data.qvel[12] = np.nan
    *_, terminated, _, info = env.step(REST)
    assert terminated
    assert info["outcome"] is Outcome.DIVERGED


def test_an_episode_times_out():
    env = AssemblyEnv(max_steps=2)
    env.reset(seed=0)
    assert env.step(REST)[3] is False
    *_, terminated, truncated, info = env.step(REST)
    assert (terminated, truncated, info["outcome"]) == (False, True, Outcome.TIMEOUT)


def test_a_state_of_another_scene_is_refused(env):
    with pytest.raises(InvalidEpisode, match="entries"):
        env.set_state(np.zeros(3))


def test_unknown_names_are_answered_with_the_nearest():
    with pytest.raises(ConfigError, match="did you mean 'one_leg'"):
        AssemblyEnv("one_lag")
    with pytest.raises(ConfigError, match="randomness 'lwo'"):
        AssemblyEnv(randomness="lwo")


def test_the_hand_pushes_a_part_along(env):
    poses = env.observation()["part_poses"].reshape(-1, 7)
    x, y = poses[4, :2]
    beside = [(x, y + 0.09, 0.10)] * 20 + [(x, y + 0.09, TABLE_HEIGHT_M + 0.02)] * 12
    sweep = [(x, target, TABLE_HEIGHT_M + 0.02) for target in np.linspace(y + 0.09, y - 0.03, 20)]
    for position in beside + sweep:
        observation, *_ = env.step(np.array([*position, 0, 1, 0, 1, 0, 0, 1.0]))
    assert np.linalg.norm(observation["part_poses"].reshape(-1, 7)[4, :2] - [x, y]) > 0.01


def test_gymnasium_accepts_the_environment(recwarn):
    env = gymnasium.make(environment_id("one_leg"))
    check_env(env.unwrapped, skip_render_check=True)
    unexpected = [str(warning.message) for warning in recwarn if "WARN" in str(warning.message)]
    unexpected = [message for message in unexpected if "observation space m" not in message]  # poses have no bounds
    assert unexpected == []


def test_every_task_can_be_made_and_drawn_by_its_name_alone():
    script = (
        "import gymnasium\n"
        f"for name in {[environment_id(task) for task in TASK_NAMES]}:\n"
        "    env = gymnasium.make(f'juicer.sim.registration:{name}', render_mode='rgb_array')\n"
        "    env.reset(seed=0)\n"
        "    assert env.render().std() > 10, name\n"
    )
    undisplayed = {name: value for name, value in os.environ.items() if name not in {"DISPLAY", "MUJOCO_GL"}}
    done = subprocess.run([sys.executable, "-c", script], env=undisplayed, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_part_poses_are_the_simulators_in_the_robot_base_frame(env):
    poses = env.observation()["part_poses"].reshape(-1, 7)
    np.testing.assert_allclose(poses[0, :3], env.data.body("square_table_top").xpos, atol=1e-6)
    assert quat_to_matrix(poses[0, 3:])[2, 1] == pytest.approx(1.0, abs=1e-5)
