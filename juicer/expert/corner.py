"""The first thing an operator does: push the part that everything is mounted on into the corner of the fence."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from juicer.errors import ConfigError
from juicer.expert.habits import Habits
from juicer.expert.pair_view import OPEN_SHARE, downward
from juicer.expert.pose import UP, Pose, heading, turned, wrapped
from juicer.expert.sight import Sight
from juicer.expert.skills import CLOSE, OPEN, Skill, Stall, descend, grip, holding, reach, rise
from juicer.sim.scene import home_xy
from juicer.tasks.handling import BaseHandling
from juicer.tasks.specification import TABLE_HEIGHT_M, AssemblyTask

_PUSH_BEYOND_M = 0.002
_CLEAR_OF_FENCE_M, _ALONG_M = 0.012, 0.004
PUSH_LEAD_M = 0.015
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
        self._handling = base.handling
        self._straight = np.array(base.handling.straight)
        self._habits = habits
        self._open_width_m = OPEN_SHARE * task.gripper_width_m
        self.home_xy = np.array(home_xy(base))

    def yaw(self, sight: Sight) -> float:
        """How far the part is turned from how it shall lie [rad]."""
        turn = sight.part(0).rotation @ self._straight.T
        return wrapped(heading(turn[:, 0]), self._handling.symmetry_rad)

    def is_home(self, sight: Sight, tolerance_m: float, tolerance_rad: float) -> bool:
        """Whether the part lies in the corner."""
        aside = float(np.abs(sight.part(0).position[:2] - self.home_xy).max())
        return aside < tolerance_m and abs(self.yaw(sight)) < tolerance_rad

    def push_home(self, sight: Sight) -> Skill:
        """Grasp the part, push it into the corner and leave it."""
        habits, handling = self._habits, self._handling
        sight = yield from descend(sight, self._grasp, habits.clearance_m, habits.pace, "go to the base")
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

    def _grasp(self, sight: Sight) -> Pose:
        """End effector over the part, its fingers on both sides of what they will hold."""
        base, handling = sight.part(0), self._handling
        across = np.array([self._habits.rim_offset_m, 0.0, handling.rim_m]) if handling.rim_m else np.zeros(3)
        position = base.position + base.rotation @ across
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
