"""How far an assembly has come: the success test, and milestones on the way.

Milestones are read from simulator truth at every step so that a failed episode shows *where* it failed. A policy
never sees them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from juicer.geometry import quat_to_matrix
from juicer.sim.scene import FENCE_CORNER_XY
from juicer.tasks.specification import AssemblyPair, AssemblyTask

POSITION_TOLERANCE_M = 0.005
AXIS_COSINE = 0.94

_PLACED_M = 0.015
_LIFTED_M = 0.05
_OVER_HOLE_M = 0.010
_INSERTED_M = 0.005
# Beads first meet 14.4 to 17.1 mm above the seat: this deep, a peg's bare tip stands in the hole's mouth.
_INSERTED_HEIGHT_M = 0.020

Array = NDArray[np.float64]


class PairTest:
    """FurnitureBench's test of one pair: each axis within 5 mm and every axis cosine at least 0.94, for any target."""

    def __init__(self, pair: AssemblyPair) -> None:
        """Prepare the targets of ``pair``."""
        self.pair = pair
        targets = np.array(pair.targets)
        self._positions, self._matrices = targets[:, :3], quat_to_matrix(targets[:, 3:])

    def offsets(self, positions: Array, matrices: Array) -> Array:
        """Position of the second part relative to each target, ``(targets, 3)`` in the first part's frame [m]."""
        first, second = self.pair.first, self.pair.second
        offsets: Array = (positions[second] - positions[first]) @ matrices[first] - self._positions
        return offsets

    def passes(self, positions: Array, matrices: Array) -> bool:
        """Whether the pair counts as assembled.

        Args:
            positions: Part positions ``(P, 3)``, all in one frame.
            matrices: Part rotations ``(P, 3, 3)``.
        """
        # Plain numbers: this runs at every step, and numpy is slow on so few of them.
        for target, offset in enumerate(self.offsets(positions, matrices).tolist()):
            if max(map(abs, offset)) <= POSITION_TOLERANCE_M:
                relative = matrices[self.pair.first].T @ matrices[self.pair.second]
                if (relative * self._matrices[target]).sum(axis=0).min() >= AXIS_COSINE:
                    return True
        return False


class Milestones:
    """Milestones of a task with one pair whose second part is screwed into the first."""

    def __init__(self, task: AssemblyTask, test: PairTest) -> None:
        """Prepare for ``task``, whose only pair is tested by ``test``."""
        self._test = test
        first, second = task.parts[test.pair.first], task.parts[test.pair.second]
        # A square top in the corner has its outer faces at the fence's inner faces.
        self._home_x, self._home_y = (corner - first.footprint[0] / 2 for corner in FENCE_CORNER_XY)
        self._lifted_z = second.start[2] + _LIFTED_M

    def reached(self, positions: Array, matrices: Array, assembled: bool) -> tuple[bool, ...]:
        """Which milestones hold at this moment, in the order of ``task.milestones``.

        Args:
            positions: Part positions ``(P, 3)`` in the robot base frame.
            matrices: Part rotations ``(P, 3, 3)``.
            assembled: Whether the pair is assembled.
        """
        first, second = self._test.pair.first, self._test.pair.second
        top_x, top_y, _ = positions[first].tolist()
        placed = abs(self._home_x - top_x) < _PLACED_M and abs(self._home_y - top_y) < _PLACED_M
        lifted = float(positions[second, 2]) > self._lifted_z
        upright = float(matrices[second, 2, 1]) > AXIS_COSINE
        if not upright:
            return (placed, lifted, False, False, False, assembled)
        offsets = self._test.offsets(positions, matrices)
        lateral = np.hypot(offsets[:, 0], offsets[:, 2])
        nearest = int(np.argmin(lateral))
        in_hole = float(lateral[nearest]) < _INSERTED_M and float(offsets[nearest, 1]) < _INSERTED_HEIGHT_M
        over_hole = float(lateral[nearest]) < _OVER_HOLE_M and (lifted or in_hole)
        return (placed, lifted, lifted, over_hole, in_hole, assembled)
