"""Lay a part down elsewhere, where it is in nobody's way and can be picked up again."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator

import numpy as np

from juicer.expert.corner import leave
from juicer.expert.gripper_room import REACHABLE, Block, clears_fence, has_room, is_clear, surroundings
from juicer.expert.habits import Habits
from juicer.expert.part_view import PartView
from juicer.expert.picking import Picking, Shift
from juicer.expert.pose import UP, Pose, heading, pose_of, turned
from juicer.expert.sight import Sight
from juicer.expert.skills import CLOSE, Skill, Stall, descend, grip, holding, near, reach, rise
from juicer.tasks.specification import TABLE_HEIGHT_M, AssemblyTask

_GRID_M = 0.02
# What is left between a part that is laid down, or the gripper that does it, and the others.
_MARGIN_M = 0.008
# A leg that hangs from the fingers, held beside its middle, sags by up to 15 mm.
_OVER_OTHERS_M, _LEAVE_M = 0.04, 0.05
_LET_GO_M, _LOWER_LEAD_M = 0.004, 0.010

KeepsClear = Callable[[Pose], bool]
"""Whether a part that is laid at a pose is in nobody's way."""


class Laying:
    """Takes one part from where it lies to where it usually lies, or as near to that as there is room."""

    def __init__(self, task: AssemblyTask, view: PartView, habits: Habits) -> None:
        """Prepare to lay the part of ``view`` elsewhere."""
        self._task = task
        self._view = view
        self._habits = habits
        self._picking = Picking(task, view, habits)
        self._start = pose_of(task.parts[view.part_index].start)

    @property
    def reach_m(self) -> float:
        """How far the part reaches from its middle [m]."""
        return max(self._view.handling.half_size_m)

    def can_be_grasped(self, sight: Sight) -> bool:
        """Whether an upright gripper has room on the part."""
        return self._picking.upright_room(sight) is not None

    def place(self, sight: Sight, keeps_clear: KeepsClear) -> Pose | None:
        """Where to lay the part; None if there is room nowhere.

        A part that lies is turned as it usually lies, so that it can be stood up; one that stands is not.
        """
        others = [
            Block(block.pose, block.half_size + _MARGIN_M)
            for block in surroundings(self._task, sight, grasped=self._view.part_index)
        ]
        rotation = self._view.part(sight).rotation
        if self._view.handling.lies:
            rotation = turned((heading(self._start.rotation[:, 1]) - heading(rotation[:, 1])) * UP, rotation)
        for x, y in self._places():
            place = Pose(np.array([x, y, self._start.position[2]]), rotation)
            if keeps_clear(place) and self._has_room(place, others):
                return place
        return None

    def lay(self, sight: Sight, place: Pose, name: str) -> Skill:
        """Grasp the part with an upright end effector, carry it over the others and put it down.

        Args:
            sight: What there is to be seen.
            place: Where to.
            name: What the part is called in phases.
        """
        view, habits = self._view, self._habits
        shift = self._picking.upright_room(sight) or Shift()
        lower = habits.pace.at_most(_LOWER_LEAD_M)

        def grasp(sight: Sight) -> Pose:
            return self._picking.grasp(view.part(sight), 0.0, shift)

        def over_the_place(sight: Sight) -> Pose:
            goal = holding(sight, view.part(sight), place)
            return Pose(np.array([*goal.position[:2], height]), goal.rotation)

        def arrived(sight: Sight) -> bool:
            return there(sight) or stall(sight) or not view.is_held(sight)

        def put_down(sight: Sight) -> bool:
            low = float(view.part(sight).position[2]) < place.position[2] + _LET_GO_M
            return low or stall(sight) or not view.is_held(sight)

        sight = yield from descend(
            sight, grasp, habits.clearance_m, habits.pace, f"go to {name}", view.handling.pick_play_m
        )
        sight = yield from grip(sight, CLOSE, view.is_closed_on_part, f"grasp {name}")
        if view.is_held(sight):
            height = float(sight.end_effector.position[2]) - TABLE_HEIGHT_M + self._highest(sight) + _OVER_OTHERS_M
            sight = yield from rise(sight, height, CLOSE, habits.pace, f"take {name} up")
            there, stall = near(over_the_place, 0.01, math.radians(5)), Stall()
            sight = yield from reach(sight, over_the_place, CLOSE, habits.pace, arrived, f"bring {name} aside")
            stall = Stall()
            sight = yield from reach(
                sight,
                lambda sight: holding(sight, view.part(sight), place),
                CLOSE,
                lower,
                put_down,
                f"lay {name} aside",
            )
        rise_m = self._highest(sight) + _OVER_OTHERS_M - float(sight.end_effector.position[2])
        return (yield from leave(sight, view.open_width_m, habits, f"leave {name}", max(_LEAVE_M, rise_m)))

    def _highest(self, sight: Sight) -> float:
        """Height up to which the other parts reach [m]."""
        others = surroundings(self._task, sight, grasped=self._view.part_index)
        return max(float(other.pose.position[2] + np.abs(other.pose.rotation[2]) @ other.half_size) for other in others)

    def _places(self) -> Iterator[tuple[float, float]]:
        """Points of the table within reach, the nearest to the usual one first."""
        low, high = REACHABLE
        grid = itertools.product(np.arange(low[0], high[0], _GRID_M), np.arange(low[1], high[1], _GRID_M))
        usual = self._start.position[:2]
        points = [(float(x), float(y)) for x, y in grid]
        yield from sorted(points, key=lambda point: float(np.hypot(*(np.array(point) - usual))))

    def _has_room(self, place: Pose, others: list[Block]) -> bool:
        """Whether the part can lie there, be let go, and be picked up again."""
        if not is_clear(Block(place, np.array(self._view.handling.half_size_m)), others):
            return False
        grasps = (self._picking.grasp(place, tilt, Shift()) for tilt in (0.0, self._habits.tilt_rad))
        return all(clears_fence(grasp) and has_room(grasp, others) for grasp in grasps)
