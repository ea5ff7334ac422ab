"""Many assembly environments stepped in parallel threads (MuJoCo releases Python's lock while it steps)."""

from __future__ import annotations

import copy
import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, Self

import numpy as np
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from numpy.typing import NDArray

from juicer.errors import ConfigError, InvalidAction
from juicer.sim.arguments import RESET_MASK, checked_count, checked_mask, checked_seeds
from juicer.sim.controller import check_action, real_numbers
from juicer.sim.env import AssemblyEnv, Observation


class AssemblyVectorEnv(SyncVectorEnv):
    """``num_envs`` independent environments; what happens in one depends on neither the others nor the threads.

    Environments are reset by the caller (Gymnasium's ``AutoresetMode.DISABLED``): ``reset(seed=..., options=
    {"reset_mask": mask})`` starts new episodes where the mask is true. Like a single one, it can be copied and pickled.
    """

    envs: list[AssemblyEnv]  # type: ignore[assignment]  # Gymnasium's may hold any environments

    def __init__(
        self,
        num_envs: int,
        task: str = "one_leg",
        randomness: str = "low",
        render_mode: str | None = None,
        max_steps: int | None = None,
        num_threads: int = 2,
        max_episode_steps: int | None = None,
        shift: object = None,
    ) -> None:
        """Create the environments; they are stepped by ``num_threads`` threads.

        Args:
            num_envs: How many.
            task: Assembly task.
            randomness: Level of the initial states.
            render_mode: ``rgb_array`` or None.
            max_steps: Steps after which an episode times out; the task's own limit if None.
            num_threads: Threads that step environments.
            max_episode_steps: What :func:`gymnasium.make_vec` calls ``max_steps``.
            shift: In what they differ from training, see :class:`juicer.sim.env.AssemblyEnv`.

        Raises:
            ConfigError: If the task, the randomness, the render mode or the shift is unknown, or a number is none.
        """
        # Gymnasium closes whatever is garbage collected, also what was never made.
        self._threads: tuple[int, ThreadPoolExecutor] | None = None
        self._num_threads = checked_count("num_threads", num_threads)
        limit = max_episode_steps if max_steps is None else max_steps
        make = partial(AssemblyEnv, task, randomness, render_mode, limit, shift)
        super().__init__([make] * checked_count("num_envs", num_envs), autoreset_mode=AutoresetMode.DISABLED)

    def __copy__(self) -> Self:
        return copy.deepcopy(self)

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_threads": None}

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode in every environment, or in those of ``options["reset_mask"]``.

        Args:
            seed: One seed an environment, or a first one from which environment ``i`` takes ``seed + i``. Those of None
                go on with their own random numbers.
            options: May hold ``reset_mask``, a boolean array ``(num_envs,)``.

        Raises:
            ConfigError: If a seed or an option is not valid, or the mask leaves out what has never been reset.
        """
        self._require_open()
        seeds = checked_seeds(seed, self.num_envs)
        mask = checked_mask(options, self.num_envs)
        for index, env in enumerate(self.envs):
            if not mask[index] and not env.has_begun:
                raise ConfigError(f"environment {index} was never reset; options['{RESET_MASK}'] must not leave it out")
        chosen = np.flatnonzero(mask).tolist()
        started = self._in_parallel(lambda index: self.envs[index].reset(seed=seeds[index]), chosen)
        infos: dict[str, Any] = {}
        for index, (_, info) in zip(chosen, started, strict=True):
            infos = self._add_info(infos, info, index)
        return _batched([env.observation() for env in self.envs]), infos

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[Observation, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Step every environment with its row of ``actions`` ``(num_envs, 10)``.

        Raises:
            InvalidAction: If a row is not valid, or an environment was not reset since its episode ended; none has
                moved.
        """
        self._require_open()
        rows = self._checked(actions)
        results = self._in_parallel(lambda index: self.envs[index].step(rows[index]), range(self.num_envs))
        observations, rewards, terminations, truncations, infos = zip(*results, strict=True)
        merged: dict[str, Any] = {}
        for index, info in enumerate(infos):
            merged = self._add_info(merged, info, index)
        return (
            _batched(observations),
            np.array(rewards, dtype=np.float64),
            np.array(terminations, dtype=np.bool_),
            np.array(truncations, dtype=np.bool_),
            merged,
        )

    def close_extras(self, **kwargs: Any) -> None:
        """Stop the threads and free every environment."""
        if self._threads is not None:
            self._threads[1].shutdown()
            self._threads = None
        super().close_extras(**kwargs)

    def _checked(self, actions: NDArray[np.float32]) -> NDArray[np.generic]:
        rows = real_numbers(actions, "actions")
        if rows.shape != self.action_space.shape:
            raise InvalidAction(f"actions must have shape {self.action_space.shape}, got {rows.shape}")
        for index, env in enumerate(self.envs):
            if not env.has_begun:
                raise InvalidAction(f"environment {index} was never reset; call reset() before the first step")
            if env.outcome is not None:
                raise InvalidAction(
                    f"the episode of environment {index} has ended with '{env.outcome}'; reset it before the next step"
                )
            try:
                check_action(rows[index])
            except InvalidAction as error:
                raise InvalidAction(f"environment {index}: {error}") from None
        return rows

    def _require_open(self) -> None:
        if self.closed:
            raise ConfigError("the environments were closed; make new ones")

    def _in_parallel(self, work: Callable[[int], Any], indices: Iterable[int]) -> list[Any]:
        # Threads do not survive a fork.
        if self._threads is None or self._threads[0] != os.getpid():
            self._threads = os.getpid(), ThreadPoolExecutor(self._num_threads)
        return list(self._threads[1].map(work, indices))


def _batched(observations: Sequence[Observation]) -> Observation:
    return {key: np.stack([observation[key] for observation in observations]) for key in observations[0]}
