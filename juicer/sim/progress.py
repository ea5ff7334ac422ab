"""How far an assembly has come: success test, sticky rewards, and milestones for one pair of parts.

Milestones are read from simulator truth at every step so that a failed episode shows *where* it failed. A policy
never sees them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from juicer.geometry import quat_to_matrix, relative_pose
from juicer.sim.scene import FENCE_CORNER_XY
from juicer.tasks.specification import AssemblyPair, AssemblyTask

POSITION_TOLERANCE_M = 0.005
AXIS_COSINE = 0.94

_PLACED_M = 0.015
_LIFTED_M = 0.05
_OVER_HOLE_M = 0.010
_INSERTED_M = 0.005
# Beads first meet 14.4 to 17.1 mm above the seat; with its tip this deep a peg stands in the hole.
_INSERTED_HEIGHT_M = 0.020


def is_assembled(pair: AssemblyPair, poses: NDArray[np.float64]) -> bool:
    """FurnitureBench's test: each axis within 5 mm and every axis cosine at least 0.94, for any target.

    Args:
        pair: The pair tested.
        poses: Part poses ``(P, 7)``, all in one frame.
    """
    relative = relative_pose(poses[pair.first], poses[pair.second])
    rotation = quat_to_matrix(relative[3:])
    for target in pair.targets:
        offset = relative[:3] - target[:3]
        cosines = np.sum(rotation * quat_to_matrix(np.array(target[3:])), axis=0)
        if (np.abs(offset) <= POSITION_TOLERANCE_M).all() and (cosines >= AXIS_COSINE).all():
            return True
    return False


def milestones_reached(task: AssemblyTask, poses: NDArray[np.float64], assembled: bool) -> tuple[bool, ...]:
    """Which of the task's milestones hold at this moment, in the order of ``task.milestones``.

    Args:
        task: A task with one pair whose second part is screwed into the first.
        poses: Part poses ``(P, 7)`` in the robot base frame.
        assembled: Whether the pair passes :func:`is_assembled`.
    """
    pair = task.pairs[0]
    top, leg = poses[pair.first], poses[pair.second]
    # A square top in the corner: both its outer faces near the fence's inner faces.
    half_width = task.parts[pair.first].footprint[0] / 2
    gap = np.asarray(FENCE_CORNER_XY) - half_width - top[:2]
    placed = bool((np.abs(gap) < _PLACED_M).all())
    lifted = bool(leg[2] - task.parts[pair.second].start[2] > _LIFTED_M)
    upright = lifted and bool(quat_to_matrix(leg[3:])[2, 1] > AXIS_COSINE)
    relative = relative_pose(top, leg)
    offsets = relative[:3] - np.array([target[:3] for target in pair.targets])
    nearest = offsets[np.argmin(np.hypot(offsets[:, 0], offsets[:, 2]))]
    lateral = float(np.hypot(nearest[0], nearest[2]))
    over_hole = upright and lateral < _OVER_HOLE_M
    standing = quat_to_matrix(relative[3:])[1, 1] > AXIS_COSINE
    inserted = bool(standing and lateral < _INSERTED_M and nearest[1] < _INSERTED_HEIGHT_M)
    return (placed, lifted, upright, over_hole or inserted, inserted, assembled)
