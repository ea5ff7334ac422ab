"""Step an environment and keep what an episode needs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from juicer.episode import SIMULATOR, STATE_KEY, Episode, EpisodeRecord, Role
from juicer.sim.controller import validate_action
from juicer.sim.env import AssemblyEnv

_SHOWN = SIMULATOR.names(Role.OBSERVATION)


class EpisodeRecorder:
    """Records every step of an environment, from its present state on.

    Attributes:
        observation: What the environment shows now, before the next action.
        info: Facts that came with the last step; empty before the first.
        done: Whether the last step ended the episode.
    """

    def __init__(self, env: AssemblyEnv) -> None:
        """Start recording at the environment's present state."""
        self._env = env
        self._steps: dict[str, list[NDArray[np.generic] | float]] = {name: [] for name in SIMULATOR.names()}
        self.observation: Mapping[str, NDArray[np.float32]] = env.observation()
        self.info: Mapping[str, Any] = {}
        self.done = False

    def __len__(self) -> int:
        """Number of steps recorded."""
        return len(self._steps["action"])

    def step(self, action: NDArray[Any]) -> None:
        """Record the present observation and simulator state with the action, then execute it.

        Args:
            action: ``(10,)``, see :data:`juicer.episode.ACTION_SIZE`.

        Raises:
            InvalidAction: If the environment refuses the action; nothing is recorded.
        """
        # The action is rounded before it acts, so that the stored one replays to the same states.
        action = validate_action(action).astype(np.float32)
        before = self._env.get_state()
        observation, reward, terminated, truncated, self.info = self._env.step(action)
        for name in _SHOWN:
            self._steps[name].append(self.observation[name])
        self._steps[STATE_KEY].append(before)
        self._steps["action"].append(action)
        self._steps["reward"].append(float(reward))
        self.observation, self.done = observation, bool(terminated or truncated)

    def episode(self, record: EpisodeRecord) -> Episode:
        """Everything recorded so far as one episode.

        Raises:
            InvalidEpisode: If nothing was recorded.
        """
        final = {name: self.observation[name] for name in _SHOWN}
        return Episode(
            record=record,
            steps={spec.name: np.asarray(self._steps[spec.name], dtype=spec.dtype) for spec in SIMULATOR},
            final={**final, STATE_KEY: self._env.get_state()},
        )
