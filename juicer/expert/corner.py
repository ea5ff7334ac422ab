"""The first thing an operator does: push the part that everything is mounted on into the corner of the fence."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from juicer.errors import ConfigError
from juicer.expert.gripper_room import has_room, solids
from juicer.expert.habits import Habits
from juicer.expert.pair_view import downward
from juicer.expert.part_view import OPEN_SHARE
from juicer.expert.pose import UP, Pose, Vector, heading, turned, wrapped
from juicer.expert.sight import Sight
from juicer.expert.skills import CLOSE, OPEN, Skill, Stall, descend, grip, holding, reach, rise
from juicer.sim.scene import home_xy
from juicer.tasks.handling import BaseHandling
from juicer.tasks.specification import TABLE_HEIGHT_M, AssemblyTask

_PUSH_BEYOND_M = 0.002
_CLEAR_OF_FENCE_M, _ALONG_M = 0.012, 0.004
PUSH_LEAD_M = 0.015
# What lies with its middle farther aside of the way than this is pushed aside: at low and medium randomness, all does.
_BESIDE_M, _WAY_POINTS = 0.012, 13
_RIM_SHIFTS_M = (0.0, 0.02, -0.02, 0.04, -0.04)
_UPRIGHT_COSINE = math.cos(math.radians(5))


class Corner:
    """The first part of a task and its place in the corner."""

    def __init__(self, task: AssemblyTask, habits: Habits) -> None:
        """Prepare to work on ``task``.

        Raises:
            ConfigError: If it is not known how the part is handled.
        """
        base = task.parts[0]
        if not isinstance(base.handling, BaseHandling):
            raise ConfigError(f"the scripted operator has not learned '{task.name}': it cannot push '{base.name}'")
        self._task = task
        self._handling = base.handling
        self._straight = np.array(base.handling.straight)
        self._habits = habits
        self._open_width_m = OPEN_SHARE * task.gripper_width_m
        self.home_xy = np.array(home_xy(base))
        self._half_m, self._is_round = max(base.footprint) / 2, base.is_round

    def yaw(self, sight: Sight) -> float:
        """How far the part is turned from how it shall lie, or from a turn at which it looks the same [rad]."""
        return wrapped(self._whole_yaw(sight), self._handling.symmetry_rad)

    def _whole_yaw(self, sight: Sight) -> float:
        turn = sight.part(0).rotation @ self._straight.T
        return heading(turn[:, 0])

    def is_home(self, sight: Sight, tolerance_m: float, tolerance_rad: float) -> bool:
        """Whether the part lies in the corner."""
        aside = float(np.abs(sight.part(0).position[:2] - self.home_xy).max())
        return aside < tolerance_m and abs(self.yaw(sight)) < tolerance_rad

    def is_in_the_way(self, sight: Sight, point: Vector) -> bool:
        """Whether something with its middle at a point would be pushed along into the corner, not merely aside.

        What lies on the part comes along anyway.
        """
        now, *later = self._apart_on_the_way(sight, point)
        return now > 0 and min(later) < _BESIDE_M

    def keeps_clear(self, sight: Sight, point: Vector, reach_m: float) -> bool:
        """Whether something that reaches so far from a point touches the part nowhere on its way into the corner."""
        return min(self._apart_on_the_way(sight, point)) > reach_m

    def _apart_on_the_way(self, sight: Sight, point: Vector) -> list[float]:
        """Distances of a point from the part's edge, negative inside it, from where it is to the corner [m]."""
        here, yaw = sight.part(0).position[:2], self.yaw(sight)
        shares = np.linspace(0.0, 1.0, _WAY_POINTS).tolist()
        way = self.home_xy - here
        return [self._apart(point[:2] - here - share * way, (1 - share) * yaw) for share in shares]

    def _apart(self, offset: Vector, yaw_rad: float) -> float:
        x, y = offset.tolist()
        if self._is_round:
            return math.hypot(x, y) - self._half_m
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)
        aside: float = max(abs(c * x + s * y), abs(c * y - s * x))
        return aside - self._half_m

    def push_home(self, sight: Sight) -> Skill:
        """Grasp the part, push it into the corner and leave it."""
        habits, handling = self._habits, self._handling
        beside_m = self._room(sight)

        def grasp(sight: Sight) -> Pose:
            return self._grasp(sight, beside_m)

        sight = yield from descend(sight, grasp, habits.clearance_m, habits.pace, "go to the base")
        sight = yield from grip(sight, CLOSE, lambda sight: sight.width < handling.width_m + 0.001, "grasp the base")
        stall = Stall()

        def pushed(sight: Sight) -> bool:
            there = self.is_home(sight, 0.002, math.radians(1.5)) or stall(sight)
            return there or self._tips(sight) or not self._holds(sight)

        pace = habits.pace.at_most(PUSH_LEAD_M)
        sight = yield from reach(sight, self._push_goal, CLOSE, pace, pushed, "push the base")
        return (yield from leave(sight, self._open_width_m, habits, "leave the base"))

    def _height(self) -> float:
        height = self._handling.height_m
        return TABLE_HEIGHT_M + (self._habits.rim_height_m if height is None else height)

    def _room(self, sight: Sight) -> float:
        """How far along the rim from the usual grasp there is room for the gripper; 0 if there is none [m]."""
        others = solids(self._task, sight, grasped=0)
        return next((beside for beside in _RIM_SHIFTS_M if has_room(self._grasp(sight, beside), others)), 0.0)

    def _grasp(self, sight: Sight, beside_m: float) -> Pose:
        """End effector over the part, its fingers on both sides of what they will hold."""
        base, handling = sight.part(0), self._handling
        along_m = self._habits.rim_offset_m + beside_m
        across = np.array([along_m, 0.0, handling.rim_m]) if handling.rim_m else np.zeros(3)
        facing = turned((self.yaw(sight) - self._whole_yaw(sight)) * UP, base.rotation)
        position = base.position + facing @ across
        position[2] = self._height()
        turn = self._habits.turn(handling.symmetry_rad)
        return Pose(position, downward(self.yaw(sight) + handling.end_effector_yaw_rad + turn))

    def _holds(self, sight: Sight) -> bool:
        return self._handling.width_m - 0.002 < sight.width < self._handling.width_m + 0.003

    def _tips(self, sight: Sight) -> bool:
        """Whether the part swings between the fingers, over the fence: let go, it falls back."""
        upright = sight.part(0).rotation @ self._straight.T
        return float(upright[2, 2]) < _UPRIGHT_COSINE

    def _push_goal(self, sight: Sight) -> Pose:
        """End effector that has pushed the held part slightly beyond its contact with the fence, side after side.

        Dragged along one side, a part that is still turned a little jams there.
        """
        base = sight.part(0)
        x, y = self.home_xy + _PUSH_BEYOND_M
        if self.home_xy[1] - base.position[1] > _ALONG_M:
            x -= _CLEAR_OF_FENCE_M
        home = np.array([x, y, base.position[2]])
        goal = holding(sight, base, Pose(home, turned(-self.yaw(sight) * UP, base.rotation)))
        position = np.array([goal.position[0], goal.position[1], self._height()])
        return Pose(position, downward(math.atan2(goal.rotation[1, 0], goal.rotation[0, 0])))


def leave(sight: Sight, open_width_m: float, habits: Habits, phase: str, rise_m: float = 0.05) -> Skill:
    """Let go and go up."""
    is_open: Callable[[Sight], bool] = lambda sight: sight.width > open_width_m  # noqa: E731
    sight = yield from grip(sight, OPEN, is_open, phase)
    return (yield from rise(sight, float(sight.end_effector.position[2]) + rise_m, OPEN, habits.pace, phase))
