"""Many assembly environments stepped in parallel threads (MuJoCo releases Python's lock while it steps)."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from juicer.sim.env import AssemblyEnv, Observation


class AssemblyVectorEnv(VectorEnv[Observation, NDArray[np.float32], NDArray[Any]]):
    """``num_envs`` independent environments; what happens in one depends on neither the others nor the threads.

    Environments are reset by the caller (Gymnasium's ``AutoresetMode.DISABLED``): ``reset(seed=..., options=
    {"reset_mask": mask})`` starts new episodes where the mask is true.
    """

    def __init__(
        self,
        num_envs: int,
        task: str = "one_leg",
        randomness: str = "low",
        max_steps: int | None = None,
        num_threads: int = 2,
    ) -> None:
        """Create the environments and a pool of ``num_threads`` threads.

        Raises:
            ConfigError: If the task or the randomness is unknown.
        """
        self.envs = [AssemblyEnv(task, randomness, max_steps=max_steps) for _ in range(num_envs)]
        self.num_envs = num_envs
        self.metadata = {**AssemblyEnv.metadata, "autoreset_mode": AutoresetMode.DISABLED}
        self.single_observation_space = self.envs[0].observation_space
        self.single_action_space = self.envs[0].action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._pool = ThreadPoolExecutor(num_threads)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode in every environment, or in those of ``options["reset_mask"]``.

        Args:
            seed: One seed an environment, or a first one from which environment ``i`` takes ``seed + i``.
            options: May hold ``reset_mask``, a boolean array ``(num_envs,)``.
        """
        seeds: Sequence[int | None]
        seeds = list(range(seed, seed + self.num_envs)) if isinstance(seed, int) else seed or [None] * self.num_envs
        mask = (options or {}).get("reset_mask", np.ones(self.num_envs, dtype=bool))

        def start(index: int) -> tuple[Observation, dict[str, Any]]:
            env = self.envs[index]
            return env.reset(seed=seeds[index]) if mask[index] else (env.observation(), {})

        results = list(self._pool.map(start, range(self.num_envs)))
        return _batched([result[0] for result in results]), self._infos([result[1] for result in results])

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[Observation, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Step every environment with its row of ``actions`` ``(num_envs, 10)``.

        Raises:
            InvalidAction: If a row is not valid.
        """
        results = list(self._pool.map(lambda env, action: env.step(action), self.envs, actions))
        observations, rewards, terminations, truncations, infos = zip(*results, strict=True)
        return (
            _batched(observations),
            np.array(rewards, dtype=np.float64),
            np.array(terminations, dtype=np.bool_),
            np.array(truncations, dtype=np.bool_),
            self._infos(infos),
        )

    def close_extras(self, **kwargs: Any) -> None:
        """Stop the threads and free every environment."""
        self._pool.shutdown()
        for env in self.envs:
            env.close()

    def _infos(self, infos: Sequence[dict[str, Any]]) -> dict[str, Any]:
        merged: dict[str, Any] = {}
        for index, info in enumerate(infos):
            merged = self._add_info(merged, info, index)
        return merged


def _batched(observations: Sequence[Observation]) -> Observation:
    return {key: np.stack([observation[key] for observation in observations]) for key in observations[0]}
