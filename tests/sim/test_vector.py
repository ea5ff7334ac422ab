import numpy as np
import pytest

from juicer.sim.env import AssemblyEnv
from juicer.sim.vector import AssemblyVectorEnv

ACTION = np.array([0.5, 0.15, 0.02, 0, 1, 0, 1, 0, 0, 1], dtype=np.float32)


def run(num_envs: int, num_threads: int, seeds: list[int]) -> dict[int, np.ndarray]:
    envs = AssemblyVectorEnv(num_envs, num_threads=num_threads)
    states = {}
    for first in range(0, len(seeds), num_envs):
        batch = seeds[first : first + num_envs]
        envs.reset(seed=batch)
        for _ in range(12):
            envs.step(np.tile(ACTION, (num_envs, 1)))
        states.update({seed: env.get_state() for seed, env in zip(batch, envs.envs, strict=True)})
    envs.close()
    return states


@pytest.mark.parametrize(("num_envs", "num_threads"), [(2, 1), (4, 2), (4, 4)])
def test_results_depend_neither_on_the_number_of_environments_nor_of_threads(num_envs, num_threads):
    seeds = [3, 1, 4, 15]
    alone = run(1, 1, seeds)
    together = run(num_envs, num_threads, seeds)
    for seed in seeds:
        np.testing.assert_array_equal(together[seed], alone[seed])


def test_a_mask_resets_only_some():
    envs = AssemblyVectorEnv(2)
    envs.reset(seed=0)
    envs.step(np.tile(ACTION, (2, 1)))
    kept = envs.envs[1].get_state()
    observation, _ = envs.reset(seed=[8, 9], options={"reset_mask": np.array([True, False])})
    np.testing.assert_array_equal(envs.envs[1].get_state(), kept)
    lone = AssemblyEnv()
    np.testing.assert_array_equal(observation["part_poses"][0], lone.reset(seed=8)[0]["part_poses"])
    envs.close()
