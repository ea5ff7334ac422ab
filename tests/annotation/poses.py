"""Where parts are when some pairs are assembled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from juicer.geometry import matrix_to_quat, quat_to_matrix
from juicer.sim.scene import home_xy
from juicer.tasks.specification import AssemblyTask


def part_poses(task: AssemblyTask, mounted: list[int]) -> NDArray[np.float64]:
    """Poses ``(7 * P,)`` with the base in its corner, some pairs at a target of theirs, the others where they start."""
    poses = np.array([part.start for part in task.parts], np.float64)
    poses[0, :2] = home_xy(task.parts[0])
    for index in mounted:
        pair = task.pairs[index]
        target = np.array(pair.targets[pair.operator_target])
        matrix = quat_to_matrix(poses[pair.first, 3:])
        poses[pair.second, :3] = poses[pair.first, :3] + matrix @ target[:3]
        poses[pair.second, 3:] = matrix_to_quat(matrix @ quat_to_matrix(target[3:]))
    return poses.ravel()
