"""Which tasks a policy is for, and observations that tell them apart."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from juicer.policy.config import TASK_KEY, FeatureSpec

PART_POSES = "part_poses"
"""The observation whose size depends on the task."""

Tasks = Mapping[str, FeatureSpec]
"""What a policy has to know of each task it is for, by name; a task's place is its number."""


def size_of_part_poses(spec: FeatureSpec) -> int:
    """Numbers of the part poses of a task."""
    return 7 * spec.num_parts


def as_shown(observations: Mapping[str, NDArray[Any]], tasks: Tasks, task: str) -> dict[str, NDArray[Any]]:
    """Observations of one task as the network of a policy for all of ``tasks`` is shown them.

    Args:
        observations: Observations ``(..., T_o, *shape)`` or ``(T, *shape)`` by name, proprioception among them.
        tasks: What the policy is for.
        task: Name of the task, one of these.
    """
    shown = dict(observations)
    if len(tasks) > 1:
        steps = shown["proprioception"].shape[:-1]
        shown[TASK_KEY] = np.full((*steps, 1), list(tasks).index(task), dtype=np.float32)
    return shown
