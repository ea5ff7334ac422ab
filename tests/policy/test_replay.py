"""Open-loop replay plays the demonstration that began most like the episode, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from juicer.errors import ConfigError, InvalidCheckpoint, InvalidObservation
from juicer.policy.checkpoint import load_policy
from juicer.policy.replay import REPLAY_FILE, ReplayPolicy

UPRIGHT = [1.0, 0.0, 0.0, 0.0]
QUARTER_TURN = [np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]


def poses(x, quat=UPRIGHT, other=0.0):
    return np.array([x, 0.0, 0.0, *quat, other, 0.0, 0.0, *UPRIGHT], dtype=np.float32)


@pytest.fixture
def policy():
    first = np.stack([poses(0.0), poses(0.1), poses(0.1, QUARTER_TURN)])
    actions = [np.full((length, 10), value, np.float32) for length, value in ((2, 0.1), (3, 0.2), (4, 0.3))]
    actions[0][1] = 0.9
    return ReplayPolicy(first, actions, parts=[0], steps=5)


def play(policy, *rows):
    return policy.predict({"part_poses": np.stack(rows)[:, None]}, [np.random.default_rng(0)] * len(rows))


def test_nearest_demonstration_is_played_and_its_last_action_held(policy):
    chunks = play(policy, poses(0.01), poses(0.09), poses(0.09, QUARTER_TURN))
    assert chunks.shape == (3, policy.action_horizon, 10) == (3, 5, 10)
    np.testing.assert_allclose(chunks[0, :, 0], [0.1, 0.9, 0.9, 0.9, 0.9])
    np.testing.assert_allclose(chunks[1:, :, 0], [[0.2] * 5, [0.3] * 5])


def test_it_looks_at_the_parts_only(policy):
    assert [spec.name for spec in policy.observations] == ["part_poses"]


def test_parts_that_do_not_matter_decide_nothing(policy):
    np.testing.assert_array_equal(play(policy, poses(0.0, other=9.0)), play(policy, poses(0.0)))


def test_checkpoint_plays_the_same(policy, tmp_path):
    policy.save(tmp_path, "toy")
    row = poses(0.1, QUARTER_TURN)
    np.testing.assert_array_equal(play(load_policy(tmp_path, "toy"), row), play(policy, row))


def test_damaged_checkpoint_is_told_in_a_sentence(policy, tmp_path):
    policy.save(tmp_path, "toy")
    whole = (tmp_path / REPLAY_FILE).read_bytes()
    (tmp_path / REPLAY_FILE).write_bytes(whole[:-40])
    with pytest.raises(InvalidCheckpoint, match="cannot be read"):
        load_policy(tmp_path, "toy")


def test_demonstrations_of_another_task_are_refused(policy, tmp_path):
    policy.save(tmp_path, "toy")
    with pytest.raises(InvalidCheckpoint, match="show 'toy', not 'lamp'"):
        load_policy(tmp_path, "lamp")


def test_observations_of_another_number_of_parts_are_refused(policy):
    with pytest.raises(InvalidObservation, match="show 2 parts, the observations 4"):
        play(policy, np.concatenate([poses(0.0), poses(0.0)]))


def test_last_action_is_held_however_long_the_episode_may_take(policy, tmp_path):
    policy.save(tmp_path, "toy")
    longer = load_policy(tmp_path, "toy", max_steps=12)
    assert longer.action_horizon == 12
    np.testing.assert_allclose(play(longer, poses(0.0))[0, :, 0], [0.1] + [0.9] * 11)
    assert load_policy(tmp_path, "toy", max_steps=3).action_horizon == policy.action_horizon


def test_a_replay_is_not_asked_for_sampling_steps(policy, tmp_path):
    policy.save(tmp_path, "toy")
    with pytest.raises(ConfigError, match="a replay has no inference_steps"):
        load_policy(tmp_path, "toy", inference_steps=4)
