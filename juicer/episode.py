"""The episode: aligned steps from one reset to its end, whatever its source.

The observation and the simulator state of index ``t`` were taken *before* the action of index ``t``.
The last observation, which no action follows, is kept apart in ``final``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from juicer.errors import InvalidEpisode

PROPRIOCEPTION_SIZE = 16
"""End-effector position (3, m, robot base frame), rotation 6D (6), linear velocity (3, m/s),
angular velocity (3, rad/s), gripper width (1, m)."""

ACTION_SIZE = 10
"""Absolute end-effector target position (3, m, robot base frame), rotation 6D (6), gripper (+1 close, -1 open)."""

OBSERVATION_KEYS = ("proprioception", "part_poses")
"""Arrays a policy may see. ``part_poses`` is 7 a part: position (m, robot base frame) and quaternion wxyz."""

STATE_KEY = "sim_state"
STEP_DTYPES: Mapping[str, type[np.generic]] = {
    "proprioception": np.float32,
    "part_poses": np.float32,
    "sim_state": np.float64,
    "action": np.float32,
    "reward": np.float32,
}
"""Per-step arrays and their storage types; ``sim_state`` restores the simulator exactly."""

FINAL_KEYS = (*OBSERVATION_KEYS, STATE_KEY)


class Source(StrEnum):
    """Where an episode comes from."""

    TELEOP = "teleop"
    AUGMENTATION = "augmentation"
    ROLLOUT = "rollout"


class Outcome(StrEnum):
    """How an episode ended."""

    SUCCESS = "success"
    TIMEOUT = "timeout"
    PART_LOST = "part_lost"
    DIVERGED = "diverged"


@dataclass(frozen=True)
class EpisodeRecord:
    """Facts about one episode: a row of ``episodes.parquet``.

    Attributes:
        source: Where the episode comes from.
        task: Assembly task, e.g. ``one_leg``.
        randomness: Level of the initial state: ``low``, ``med`` or ``high``.
        seed: Initial-state seed that ``reset`` was given.
        outcome: How it ended.
        parts_assembled: Number of pairs assembled at its end.
        milestones: First step at which each milestone was reached, by name; absent if never reached.
        policy: Id of the checkpoint that acted, for rollouts.
        parent: ``<artifact id>/<episode>`` the episode was derived from, for augmentation.
        critical_state: Index of the critical state it returns to, for augmentation.
        device: What the operator held, for teleoperation.
    """

    source: Source
    task: str
    randomness: str
    seed: int
    outcome: Outcome
    parts_assembled: int = 0
    milestones: Mapping[str, int] = field(default_factory=dict)
    policy: str | None = None
    parent: str | None = None
    critical_state: int | None = None
    device: str | None = None


@dataclass(frozen=True)
class Episode:
    """Aligned steps and the facts about them.

    Attributes:
        record: Facts about the episode.
        steps: Arrays of :data:`STEP_DTYPES`, each ``(T, ...)``.
        final: The observation and simulator state after the last action, each without a time axis.

    Raises:
        InvalidEpisode: If an array is missing, has another length or holds a non-finite value.
    """

    record: EpisodeRecord
    steps: Mapping[str, NDArray[np.generic]]
    final: Mapping[str, NDArray[np.generic]]

    def __post_init__(self) -> None:
        """Check that every array is there, finite, and of one length."""
        if set(self.steps) != set(STEP_DTYPES):
            raise InvalidEpisode(f"an episode needs the arrays {sorted(STEP_DTYPES)}, got {sorted(self.steps)}")
        lengths = {name: len(values) for name, values in self.steps.items()}
        if len(set(lengths.values())) != 1 or len(self) == 0:
            raise InvalidEpisode(f"the arrays of an episode need one common, positive length, got {lengths}")
        for name, values in self.steps.items():
            if not np.all(np.isfinite(np.asarray(values, dtype=np.float64))):
                raise InvalidEpisode(f"array '{name}' of an episode holds NaN or infinite values")
        if self.steps["action"].shape[1:] != (ACTION_SIZE,):
            raise InvalidEpisode(f"actions must have {ACTION_SIZE} entries, got shape {self.steps['action'].shape}")
        if set(self.final) != set(FINAL_KEYS):
            raise InvalidEpisode(f"the final observation needs {sorted(FINAL_KEYS)}, got {sorted(self.final)}")

    def __len__(self) -> int:
        """Number of actions."""
        return len(self.steps["action"])


class DemonstrationReader(Protocol):
    """Episodes by number, e.g. :class:`juicer.storage.episodes.EpisodeReader`."""

    def __len__(self) -> int:
        """Number of episodes."""
        ...

    def read(self, index: int) -> Episode:
        """The episode of a number."""
        ...
