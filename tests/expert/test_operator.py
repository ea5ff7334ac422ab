"""The operator's habits: the same for the same stream, different for others."""

from __future__ import annotations

import numpy as np

from juicer.expert.operator import ScriptedOperator
from juicer.expert.steady import Steady
from juicer.geometry import rot6d_to_matrix
from juicer.sim.env import AssemblyEnv


def work(seed: int, steps: int = 25, temperament: Steady | None = None) -> np.ndarray:
    env = AssemblyEnv()
    observation, _ = env.reset(seed=3)
    operator = ScriptedOperator(env.task, np.random.default_rng(seed), temperament)
    actions = []
    for _ in range(steps):
        actions.append(operator.act(observation).action)
        observation, *_ = env.step(actions[-1])
    return np.array(actions)


def test_the_same_stream_gives_the_same_actions_and_another_gives_others():
    np.testing.assert_array_equal(work(0), work(0))
    assert np.abs(work(0) - work(1))[1:].max(axis=1).min() > 0


def test_tremor_is_as_large_as_it_is_said_to_be():
    shaking = Steady(hesitation=0.0)
    steady = Steady(tremor_m=0.0, tremor_rad=0.0, hesitation=0.0)
    first = [work(seed, 1, shaking)[0, :3] - work(seed, 1, steady)[0, :3] for seed in range(30)]
    # The first step of an autoregressive tremor is smaller than its stationary size.
    assert 0.3e-3 < np.std(first) < 1.0e-3


def test_every_action_is_a_pose():
    actions = work(0)
    rotations = rot6d_to_matrix(actions[:, 3:9])
    np.testing.assert_allclose(rotations[:, :2].reshape(-1, 6), actions[:, 3:9], atol=1e-6)
