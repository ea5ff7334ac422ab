"""How far an assembly has come: the success test, and milestones on the way.

Milestones are read from simulator truth at every step so that a failed episode shows *where* it failed. A policy
never sees them.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from juicer.geometry import quat_to_matrix
from juicer.sim.scene import home_xy
from juicer.tasks.specification import MOUNTED_COSINE, MOUNTED_M, AssemblyPair, AssemblyTask, Joint

_PLACED_M = 0.015
_LIFTED_M = 0.05
_OVER_HOLE_M = 0.010
_INSERTED_M = 0.005
# Beads first meet 14.4 to 17.1 mm above the seat: this deep, a peg's bare tip stands in the hole's mouth.
_INSERTED_HEIGHT_M = 0.020

Array = NDArray[np.float64]


class PairProgress:
    """How far the second part of a pair has come, and FurnitureBench's test of whether it is assembled.

    Assembled means within :data:`MOUNTED_M` and :data:`MOUNTED_COSINE` of any of the pair's targets.
    """

    def __init__(self, task: AssemblyTask, pair: AssemblyPair) -> None:
        """Prepare the targets of ``pair``."""
        self.pair = pair
        targets = np.array(pair.targets)
        self._positions, self._matrices = targets[:, :3], quat_to_matrix(targets[:, 3:])
        self._lifted_z = task.parts[pair.second].start[2] + _LIFTED_M
        # All targets of a pair have the same axis: that of the second part, seen from the first.
        self._axis = self._matrices[0, :, 1]
        # Outwards is where the second part comes from.
        self._outwards = float(np.sign(self._axis @ self._positions[0]))

    def measure(self, positions: Array, matrices: Array) -> tuple[bool, ...]:
        """Which milestones of the pair hold at this moment; the last is that it is assembled.

        Args:
            positions: Part positions ``(P, 3)``, z upwards.
            matrices: Part rotations ``(P, 3, 3)``.
        """
        first, second = self.pair.first, self.pair.second
        lifted = float(positions[second, 2]) > self._lifted_z
        is_screwed = self.pair.joint is Joint.SCREWED
        reference = matrices[first]
        # This runs at every step, most of them with the part lying somewhere: nothing is measured in vain.
        if is_screwed and not float(reference @ self._axis @ matrices[second, :, 1]) >= MOUNTED_COSINE:
            return (lifted, False, False, False, False)
        offsets = (positions[second] - positions[first]) @ reference - self._positions
        assembled = self._is_assembled(offsets.tolist(), reference, matrices[second])
        aside, height = self._nearest(offsets)
        if not is_screwed:
            return (lifted, lifted and aside < _OVER_HOLE_M, assembled)
        in_hole = aside < _INSERTED_M and height < _INSERTED_HEIGHT_M
        return (lifted, lifted, aside < _OVER_HOLE_M and (lifted or in_hole), in_hole, assembled)

    def _is_assembled(self, offsets: list[list[float]], first: Array, second: Array) -> bool:
        for target, offset in enumerate(offsets):
            if max(map(abs, offset)) <= MOUNTED_M:
                if self.pair.any_rotation:
                    return True
                if (first.T @ second * self._matrices[target]).sum(axis=0).min() >= MOUNTED_COSINE:
                    return True
        return False

    def _nearest(self, offsets: Array) -> tuple[float, float]:
        """Distance from the nearest target's axis, and height over its seat [m]."""
        heights = offsets @ self._axis
        squares = np.vecdot(offsets, offsets) - heights * heights
        nearest = int(squares.argmin())
        return math.sqrt(max(squares[nearest], 0.0)), self._outwards * float(heights[nearest])


class BaseProgress:
    """Whether the first part of a task has been pushed into the corner."""

    def __init__(self, task: AssemblyTask) -> None:
        """Prepare for ``task``."""
        self._home_x, self._home_y = home_xy(task.parts[0])

    def is_placed(self, positions: Array) -> bool:
        """Whether it is in the corner.

        Args:
            positions: Part positions ``(P, 3)`` in the robot base frame.
        """
        x, y = float(positions[0, 0]), float(positions[0, 1])
        return abs(self._home_x - x) < _PLACED_M and abs(self._home_y - y) < _PLACED_M


class TaskProgress:
    """Which milestones of a task hold at a moment, whatever came before."""

    def __init__(self, task: AssemblyTask) -> None:
        """Prepare for ``task``."""
        self._names = task.milestones
        self._base = BaseProgress(task)
        self._pairs = tuple(PairProgress(task, pair) for pair in task.pairs)

    def reached(self, positions: Array, matrices: Array) -> set[str]:
        """Their names.

        Args:
            positions: Part positions ``(P, 3)`` in the robot base frame.
            matrices: Part rotations ``(P, 3, 3)``.
        """
        holds = [self._base.is_placed(positions)]
        for pair in self._pairs:
            holds += pair.measure(positions, matrices)
        return {name for name, reached in zip(self._names, holds, strict=True) if reached}
