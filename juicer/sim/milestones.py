"""How far an assembly has come: the success test, and milestones on the way.

Milestones are read from simulator truth at every step so that a failed episode shows *where* it failed. A policy
never sees them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from juicer.geometry import quat_to_matrix
from juicer.sim.scene import FENCE_CORNER_XY
from juicer.tasks.specification import AssemblyPair, AssemblyTask, Joint

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
                if self.pair.any_rotation:
                    return True
                relative = matrices[self.pair.first].T @ matrices[self.pair.second]
                if (relative * self._matrices[target]).sum(axis=0).min() >= AXIS_COSINE:
                    return True
        return False


class Milestones:
    """Milestones of a task: the first part in the corner, and for each pair how far its second part has come."""

    def __init__(self, task: AssemblyTask, tests: Sequence[PairTest]) -> None:
        """Prepare for ``task``, whose pairs are tested by ``tests``."""
        base = task.parts[0]
        # A part in the corner has its outer faces at the fence's inner faces.
        self._home_x, self._home_y = (
            corner - size / 2 for corner, size in zip(FENCE_CORNER_XY, base.footprint, strict=True)
        )
        self._pairs = [_PairProgress(task, test) for test in tests]

    def reached(self, positions: Array, matrices: Array, assembled: Sequence[float]) -> list[bool]:
        """Which milestones hold at this moment, in the order of ``task.milestones``.

        Args:
            positions: Part positions ``(P, 3)`` in the robot base frame.
            matrices: Part rotations ``(P, 3, 3)``.
            assembled: Whether each pair is assembled.
        """
        x, y, _ = positions[0].tolist()
        milestones = [abs(self._home_x - x) < _PLACED_M and abs(self._home_y - y) < _PLACED_M]
        for pair, done in zip(self._pairs, assembled, strict=True):
            milestones += pair.reached(positions, matrices, bool(done))
        return milestones


class _PairProgress:
    """How far the second part of a pair has come."""

    def __init__(self, task: AssemblyTask, test: PairTest) -> None:
        self._test = test
        self._is_screwed = test.pair.joint is Joint.SCREWED
        self._lifted_z = task.parts[test.pair.second].start[2] + _LIFTED_M
        # All targets of a pair have the same axis: that of the second part, seen from the first.
        self._axis = quat_to_matrix(np.array(test.pair.targets[0][3:]))[:, 1]
        # Outwards is where the second part comes from.
        self._outwards = float(np.sign(self._axis @ np.array(test.pair.targets[0][:3])))

    def reached(self, positions: Array, matrices: Array, assembled: bool) -> tuple[bool, ...]:
        first, second = self._test.pair.first, self._test.pair.second
        lifted = float(positions[second, 2]) > self._lifted_z
        if not self._is_screwed:
            return (lifted, lifted and self._is_over(positions, matrices), assembled)
        upright = float(matrices[first] @ self._axis @ matrices[second, :, 1]) > AXIS_COSINE
        if not upright:
            return (lifted, False, False, False, assembled)
        aside, height = self._offset(positions, matrices)
        in_hole = aside < _INSERTED_M and height < _INSERTED_HEIGHT_M
        return (lifted, lifted, aside < _OVER_HOLE_M and (lifted or in_hole), in_hole, assembled)

    def _is_over(self, positions: Array, matrices: Array) -> bool:
        return self._offset(positions, matrices)[0] < _OVER_HOLE_M

    def _offset(self, positions: Array, matrices: Array) -> tuple[float, float]:
        """Distance from the nearest target's axis, and height over its seat [m]."""
        offsets = self._test.offsets(positions, matrices)
        heights = offsets @ self._axis
        aside = np.linalg.norm(offsets - heights[:, None] * self._axis, axis=1)
        nearest = int(np.argmin(aside))
        return float(aside[nearest]), self._outwards * float(heights[nearest])
