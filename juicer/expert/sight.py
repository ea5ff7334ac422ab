"""What an operator sees: the observation as poses, nothing else of the simulator."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from juicer.expert.pose import Pose, Vector, length, matrix_of_rows, pose_of
from juicer.tasks.specification import AssemblyTask


class Sight:
    """One observation.

    Attributes:
        task: The assembly task, for the shapes of its parts.
        end_effector: End effector; its z axis points out of the gripper, the fingers open along y.
        width: Gripper width [m].
    """

    def __init__(self, task: AssemblyTask, observation: Mapping[str, NDArray[np.floating[Any]]]) -> None:
        """Read an observation of the environment."""
        self.task = task
        proprioception = observation["proprioception"]
        self.end_effector = Pose(np.asarray(proprioception[:3], np.float64), matrix_of_rows(proprioception[3:9]))
        self.width = float(proprioception[15])
        self._velocity = np.asarray(proprioception[9:15], np.float64)
        self._part_poses = observation["part_poses"]
        self._parts: dict[int, Pose] = {}

    def part(self, index: int) -> Pose:
        """Pose of a part, by its index in the task."""
        if index not in self._parts:
            self._parts[index] = pose_of(self._part_poses[7 * index : 7 * index + 7].tolist())
        return self._parts[index]

    @cached_property
    def speed(self) -> float:
        """How fast the end effector moves [m/s]."""
        return length(self._velocity[:3])

    @cached_property
    def spin(self) -> float:
        """How fast the end effector turns [rad/s]."""
        return length(self._velocity[3:])

    @property
    def velocity(self) -> Vector:
        """Linear velocity of the end effector [m/s]."""
        return self._velocity[:3]
