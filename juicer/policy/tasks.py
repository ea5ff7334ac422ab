"""Which tasks a policy is for, and observations that tell them apart."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from juicer.episode import PROPRIOCEPTION_SIZE
from juicer.policy.config import TASK_KEY, FeatureSpec

Tasks = Mapping[str, FeatureSpec]
"""What a policy has to know of each task it is for, by name; a task's place is its number."""


def observation_sizes(tasks: Tasks) -> dict[str, int]:
    """Length of each observation array that a policy for these tasks is shown."""
    sizes = {"proprioception": PROPRIOCEPTION_SIZE, "part_poses": 7 * max(spec.num_parts for spec in tasks.values())}
    return sizes | ({TASK_KEY: 1} if len(tasks) > 1 else {})


def as_shown(observations: Mapping[str, NDArray[Any]], tasks: Tasks, task: str) -> dict[str, NDArray[np.float32]]:
    """Observations of one task as a policy for all of ``tasks`` is shown them.

    Args:
        observations: ``proprioception`` ``(..., 16)`` and ``part_poses`` ``(..., 7 P)`` with the task's own P.
        tasks: What the policy is for.
        task: Name of the task, one of these.
    """
    shown = {name: np.asarray(values, dtype=np.float32) for name, values in observations.items()}
    if len(tasks) > 1:
        poses = shown["part_poses"]
        missing = observation_sizes(tasks)["part_poses"] - poses.shape[-1]
        shown["part_poses"] = np.pad(poses, [*[(0, 0)] * (poses.ndim - 1), (0, missing)])
        shown[TASK_KEY] = np.full((*poses.shape[:-1], 1), list(tasks).index(task), dtype=np.float32)
    return shown
