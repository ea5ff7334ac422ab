"""How the open gripper is put on a part that lies or stands on the table."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from juicer.expert.gripper_room import clears_fence, has_room, obstacles, solids
from juicer.expert.habits import Habits
from juicer.expert.pair_view import EASY_YAW_RAD, downward
from juicer.expert.part_view import PartView
from juicer.expert.pose import UP, Pose, cross, heading, length, swing, turned, wrapped
from juicer.expert.sight import Sight
from juicer.tasks.specification import AssemblyTask

_ASIDE_M = (0.0, 0.008, -0.008)
_ALONG_M = (0.0, 0.010, -0.010, 0.019, -0.019)
_MARGINS_M = (0.005, 0.0)


@dataclass(frozen=True)
class Shift:
    """Where a grasp is, beside the usual one.

    Attributes:
        aside_m: Across the part, which stays between the fingers.
        along_m: Along its axis.
    """

    aside_m: float = 0.0
    along_m: float = 0.0


class Picking:
    """Grasps of one part."""

    def __init__(self, task: AssemblyTask, view: PartView, habits: Habits) -> None:
        """Prepare to pick up the part of ``view``."""
        self._task = task
        self._view = view
        self._habits = habits

    def grasp(self, part: Pose, tilt_rad: float, shift: Shift) -> Pose:
        """End effector over the part: across one that lies, tilted back towards its peg, else straight down.

        Args:
            part: Where the part is.
            tilt_rad: From upright.
            shift: From the usual grasp.
        """
        handling, habits = self._view.handling, self._habits
        axis = part.rotation[:, 1]
        if not handling.lies:
            flat = heading(part.rotation[:, 0]) + handling.flat_rad
            turn = habits.turn(handling.flat_every_rad)
            yaw = EASY_YAW_RAD + wrapped(flat - EASY_YAW_RAD, handling.flat_every_rad) + turn
            # One that was knocked over leans on something: the end effector leans with it.
            upwards = axis if axis[2] > 0 else -axis
            return Pose(part.position + handling.pick_m * axis, turned(swing(UP, upwards), downward(yaw)))
        along = axis - axis[2] * UP
        along = along / max(length(along), 1e-6)
        c, s = math.cos(tilt_rad), math.sin(tilt_rad)
        x, z = c * along - s * UP, -c * UP - s * along
        y = cross(z, x)
        height = habits.pick_height_m - handling.pick_below_m
        where = (handling.pick_m + habits.pick_offset_m + shift.along_m) * axis + height * UP
        return Pose(part.position + where + shift.aside_m * y, np.column_stack([x, y, z]))

    def room(self, sight: Sight, tilt_rad: float) -> Shift | None:
        """Smallest shift across the part with which the gripper has room between parts and fence, or None."""
        others = obstacles(self._task, sight, grasped=self._view.part_index)
        part = self._view.part(sight)
        for aside in _ASIDE_M:
            grasp = self.grasp(part, tilt_rad, Shift(aside))
            if clears_fence(grasp) and has_room(grasp, others):
                return Shift(aside)
        return None

    def upright_room(self, sight: Sight) -> Shift | None:
        """Smallest shift across and along the part with which an upright gripper has that room, likewise."""
        others = solids(self._task, sight, grasped=self._view.part_index)
        part = self._view.part(sight)
        for margin in _MARGINS_M:
            for along, aside in itertools.product(_ALONG_M, _ASIDE_M):
                grasp = self.grasp(part, 0.0, Shift(aside, along))
                if clears_fence(grasp, margin) and has_room(grasp, others, margin):
                    return Shift(aside, along)
        return None
