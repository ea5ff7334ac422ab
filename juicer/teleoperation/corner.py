"""The first thing an operator does: push the part that everything is mounted on into the corner of the fence."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from juicer.sim.scene import home_xy
from juicer.tasks.specification import TABLE_HEIGHT_M, AssemblyTask
from juicer.teleoperation.handling import Habits
from juicer.teleoperation.pair_view import OPEN_SHARE, downward
from juicer.teleoperation.pose import UP, Matrix, Pose, heading, turned, wrapped
from juicer.teleoperation.scene import Scene
from juicer.teleoperation.skills import CLOSE, OPEN, Skill, Stall, descend, grip, holding, reach, rise

_PUSH_BEYOND_M = 0.002
_CLEAR_OF_FENCE_M, _ALONG_M = 0.012, 0.004
PUSH_LEAD_M = 0.015
_UPRIGHT_COSINE = math.cos(math.radians(5))


@dataclass(frozen=True)
class BaseHandling:
    """How the first part is grasped to be pushed.

    Attributes:
        width_m: Its width between the fingers.
        height_m: Height of the grasp above the table; the operator's habit if None.
        rim_m: Distance of the grasp from the centre, towards the robot.
        hand_yaw_rad: Yaw of the hand, relative to the part.
        straight: Rotation ``(3, 3)`` of the part when it is not turned.
        symmetry_rad: Turn after which it looks the same.
    """

    width_m: float
    height_m: float | None
    rim_m: float
    hand_yaw_rad: float
    straight: Matrix
    symmetry_rad: float


_Y_UP = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
_Y_DOWN = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])

BASE_HANDLINGS = {
    "square_table_top": BaseHandling(0.00625, None, 0.078125, math.pi / 2, _Y_UP, 2 * math.pi),
    "round_table_top": BaseHandling(0.0425, 0.026, 0.0, 0.0, _Y_UP, math.pi / 12),
    "lamp_base": BaseHandling(0.0555, 0.058, 0.0, 0.0, _Y_DOWN, math.pi / 2),
}
"""By name of the part."""


class Corner:
    """The first part of a task and its place in the corner."""

    def __init__(self, task: AssemblyTask, habits: Habits) -> None:
        """Prepare to work on ``task``."""
        base = task.parts[0]
        self._handling = BASE_HANDLINGS[base.name]
        self._habits = habits
        self._open_width_m = OPEN_SHARE * task.gripper_width_m
        self.home_xy = np.array(home_xy(base))

    def yaw(self, scene: Scene) -> float:
        """How far the part is turned from how it shall lie [rad]."""
        turn = scene.part(0).rotation @ self._handling.straight.T
        return wrapped(heading(turn[:, 0]), self._handling.symmetry_rad)

    def is_home(self, scene: Scene, tolerance_m: float, tolerance_rad: float) -> bool:
        """Whether the part lies in the corner."""
        aside = float(np.abs(scene.part(0).position[:2] - self.home_xy).max())
        return aside < tolerance_m and abs(self.yaw(scene)) < tolerance_rad

    def push_home(self, scene: Scene) -> Skill:
        """Grasp the part, push it into the corner and leave it."""
        habits, handling = self._habits, self._handling
        scene = yield from descend(scene, self._grasp, habits.clearance_m, habits.pace, "go to the base")
        scene = yield from grip(scene, CLOSE, lambda scene: scene.width < handling.width_m + 0.001, "grasp the base")
        stall = Stall()

        def pushed(scene: Scene) -> bool:
            there = self.is_home(scene, 0.002, math.radians(1.5)) or stall(scene)
            return there or self._tips(scene) or not self._holds(scene)

        pace = habits.pace.at_most(PUSH_LEAD_M)
        scene = yield from reach(scene, self._push_goal, CLOSE, pace, pushed, "push the base")
        return (yield from leave(scene, self._open_width_m, habits, "leave the base"))

    def _height(self) -> float:
        height = self._handling.height_m
        return TABLE_HEIGHT_M + (self._habits.rim_height_m if height is None else height)

    def _grasp(self, scene: Scene) -> Pose:
        """Hand over the part, its fingers on both sides of what they will hold."""
        base, handling = scene.part(0), self._handling
        across = np.array([self._habits.rim_offset_m, 0.0, handling.rim_m]) if handling.rim_m else np.zeros(3)
        position = base.position + base.rotation @ across
        position[2] = self._height()
        return Pose(position, downward(self.yaw(scene) + handling.hand_yaw_rad))

    def _holds(self, scene: Scene) -> bool:
        return self._handling.width_m - 0.002 < scene.width < self._handling.width_m + 0.003

    def _tips(self, scene: Scene) -> bool:
        """Whether the part swings between the fingers, over the fence: let go, it falls back."""
        upright = scene.part(0).rotation @ self._handling.straight.T
        return float(upright[2, 2]) < _UPRIGHT_COSINE

    def _push_goal(self, scene: Scene) -> Pose:
        """Hand that has brought the held part slightly beyond its contact with the fence, one side after the other.

        Dragged along one side, a part that is still turned a little jams there.
        """
        base = scene.part(0)
        x, y = self.home_xy + _PUSH_BEYOND_M
        if self.home_xy[1] - base.position[1] > _ALONG_M:
            x -= _CLEAR_OF_FENCE_M
        home = np.array([x, y, base.position[2]])
        goal = holding(scene, base, Pose(home, turned(-self.yaw(scene) * UP, base.rotation)))
        position = np.array([goal.position[0], goal.position[1], self._height()])
        return Pose(position, downward(math.atan2(goal.rotation[1, 0], goal.rotation[0, 0])))


def leave(scene: Scene, open_width_m: float, habits: Habits, phase: str, rise_m: float = 0.05) -> Skill:
    """Let go and go up."""
    is_open: Callable[[Scene], bool] = lambda scene: scene.width > open_width_m  # noqa: E731
    scene = yield from grip(scene, OPEN, is_open, phase)
    return (yield from rise(scene, float(scene.hand.position[2]) + rise_m, OPEN, habits.pace, phase))
