"""What an operator who builds one_leg makes of the scene: is the top home, is the leg held, how does it stand?"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from juicer.sim.scene import FENCE_CORNER_XY
from juicer.tasks.specification import AssemblyTask
from juicer.teleoperation.pose import UP, Matrix, Pose, Vector, angle_between, heading, turned, wrapped
from juicer.teleoperation.scene import Scene

TOP_HALF_WIDTH_M, WALL_M, LEG_WIDTH_M = 0.08125, 0.00625, 0.030
LEG_HALF_SIZE_M = np.array([0.015, 0.056, 0.015])
HOME_XY = tuple(corner - TOP_HALF_WIDTH_M for corner in FENCE_CORNER_XY)
"""Where the top's centre is when it lies in the corner of the fence [m]."""

STROKE_END_RAD = math.radians(-5)
"""Yaw of the hand at the end of a screw stroke, relative to the top; a stroke begins a quarter turn before."""

_OPEN_WIDTH_M = 0.058
_ENGAGED_M, _ENGAGED_HEIGHT_M = 0.022, (-0.006, 0.020)
# The true clearances let a leg that stands in the mouth of its hole lean by up to 15 degrees.
_ENGAGED_LEAN_RAD = math.radians(30)


@dataclass(frozen=True)
class Seat:
    """The leg relative to its place in the top.

    Attributes:
        aside_m: Distance of its origin from the hole's axis.
        height_m: Height above the assembled pose.
        lean_rad: Angle between its axis and the hole's.
    """

    aside_m: float
    height_m: float
    lean_rad: float


class OneLegView:
    """Reads a scene for the parts of one_leg."""

    def __init__(self, task: AssemblyTask) -> None:
        """Look at the task's first pair."""
        pair = task.pairs[0]
        self._top, self.leg_index = pair.first, pair.second
        self._seat = np.array(pair.targets[pair.operator_target][:3])

    def top(self, scene: Scene) -> Pose:
        """Pose of the tray."""
        return scene.part(self._top)

    def leg(self, scene: Scene) -> Pose:
        """Pose of the leg."""
        return scene.part(self.leg_index)

    def top_yaw(self, scene: Scene) -> float:
        """How far the top is turned from its place in the corner [rad]."""
        return heading(-self.top(scene).rotation[:, 2])

    def is_home(self, scene: Scene, tolerance_m: float, tolerance_rad: float) -> bool:
        """Whether the top lies in the corner."""
        x, y, _ = self.top(scene).position.tolist()
        aside = max(abs(x - HOME_XY[0]), abs(y - HOME_XY[1]))
        return aside < tolerance_m and abs(self.top_yaw(scene)) < tolerance_rad

    def seat(self, scene: Scene) -> Seat:
        """How the leg stands to its hole."""
        top, leg = self.top(scene), self.leg(scene)
        x, y, z = (top.rotation.T @ (leg.position - top.position) - self._seat).tolist()
        return Seat(math.hypot(x, z), y, angle_between(leg.rotation[:, 1], top.rotation[:, 1]))

    def seat_point(self, scene: Scene, height_m: float) -> Vector:
        """Where the leg's origin is when it stands ``height_m`` above its seat."""
        top = self.top(scene)
        above = self._seat.copy()
        above[1] += height_m
        point: Vector = top.position + top.rotation @ above
        return point

    def is_engaged(self, scene: Scene) -> bool:
        """Whether the peg stands in its hole."""
        seat = self.seat(scene)
        low, high = _ENGAGED_HEIGHT_M
        return seat.aside_m < _ENGAGED_M and low < seat.height_m < high and seat.lean_rad < _ENGAGED_LEAN_RAD

    def is_held(self, scene: Scene) -> bool:
        """Whether the gripper holds the leg."""
        if not LEG_WIDTH_M - 0.003 < scene.width < LEG_WIDTH_M + 0.0035:
            return False
        x, y, z = (self.leg(scene).inverse() @ scene.hand).position.tolist()
        return bool(max(abs(x), abs(z)) < 0.012 and -0.025 < y < 0.035)

    def is_closed_on_leg(self, scene: Scene) -> bool:
        """Whether the fingers have closed as far as a leg between them lets them."""
        return scene.width < LEG_WIDTH_M + 0.0006

    def is_open(self, scene: Scene) -> bool:
        """Whether the gripper is open."""
        return scene.width > _OPEN_WIDTH_M

    def upright(self, scene: Scene) -> Matrix:
        """Rotation of the leg that stands on the top, in the quarter turn that leads the hand away from the robot."""
        top = self.top(scene)
        pointing = self.leg(scene).rotation.T @ scene.hand.rotation[:, 2]
        choices = [turned(quarter * math.pi / 2 * top.rotation[:, 1], top.rotation) for quarter in range(4)]
        return max(choices, key=lambda rotation: float((rotation @ pointing) @ -top.rotation[:, 2]))

    def hand_yaw(self, scene: Scene) -> float:
        """Heading of the hand's x axis [rad]."""
        return heading(scene.hand.rotation[:, 0])

    def hand_tilt(self, scene: Scene) -> float:
        """Angle between the hand and straight down [rad]."""
        return angle_between(-scene.hand.rotation[:, 2], UP)

    def stroke_end(self, scene: Scene) -> float:
        """Yaw of the hand at which a screw stroke ends [rad]."""
        return self.top_yaw(scene) + STROKE_END_RAD

    def stroke_start(self, scene: Scene) -> float:
        """Yaw of the hand, flat on the leg's faces, from which a stroke takes about a quarter turn [rad]."""
        wanted = self.stroke_end(scene) + math.pi / 2
        return wanted + wrapped(heading(self.leg(scene).rotation[:, 0]) - wanted, math.pi / 2)


def downward(yaw_rad: float) -> Matrix:
    """Rotation of a hand that points straight down, its x axis in the direction of a yaw."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.array([[c, s, 0.0], [s, -c, 0.0], [0.0, 0.0, -1.0]])
