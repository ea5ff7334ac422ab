"""What an operator makes of a part to be mounted: how does it stand to its seat, is it in its hole?"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from juicer.expert.part_view import PartView
from juicer.expert.pose import (
    UP,
    Matrix,
    Pose,
    Vector,
    angle_between,
    heading,
    pose_of,
    swing,
    turned,
    wrapped,
)
from juicer.expert.sight import Sight
from juicer.tasks.handling import Handling
from juicer.tasks.specification import AssemblyTask, PartSpec

STROKE_END_RAD = math.radians(-5)
"""Yaw of the end effector at the end of a screw stroke; a stroke begins a quarter turn before."""

EASY_YAW_RAD = math.radians(40)
"""Yaw of an end effector that points down from which the wrist can turn far both ways."""

_FORWARDS = np.array([1.0, 0.0, 0.0])
# Height above its seat at which a part clears the hole, beyond the hole's depth.
_CLEAR_M = 0.036
_ENGAGED_M, _ENGAGED_HEIGHT_M = 0.022, (-0.006, 0.020)
# The true clearances let a part that stands in the mouth of its hole lean by up to 25 degrees.
_ENGAGED_LEAN_RAD = math.radians(30)
_SEATED_M, _SEATED_COSINE, _TIGHT_COSINE = 0.0045, 0.943, 0.985


@dataclass(frozen=True)
class Seat:
    """A part relative to its place on another.

    Attributes:
        aside_m: Distance of its origin from the hole's axis.
        height_m: Height above the assembled pose.
        lean_rad: Angle between its axis and the hole's.
    """

    aside_m: float
    height_m: float
    lean_rad: float


class PairView(PartView):
    """Reads a scene for one pair of a task: a part that is mounted on another, its mate."""

    def __init__(self, task: AssemblyTask, pair_index: int, handling: Handling) -> None:
        """Look at a pair of ``task``."""
        pair = task.pairs[pair_index]
        super().__init__(task, pair.second, handling)
        self.mate_index = pair.first
        self.label, self._any_rotation = pair.label, pair.any_rotation
        self._target = pose_of(pair.targets[pair.operator_target])
        # Upwards along the seat's axis: the part may have its y axis down.
        self._upwards = 1.0 if float(self._target.rotation[:, 1] @ self._target.position) > 0 else -1.0
        self.depth_m = self._thread_m(task.parts[pair.first], task.parts[pair.second]) + handling.around_m
        self.clear_m = self.depth_m + _CLEAR_M if handling.clear_m is None else handling.clear_m

    def _thread_m(self, mate: PartSpec, part: PartSpec) -> float:
        """How deep in its bore the tip of the part's peg is once it is mounted; 0 for a part without a peg [m]."""
        if not part.pegs:
            return 0.0
        seat_y = float(self._target.position[1])
        tip_y = seat_y + part.pegs[0].tip_y * float(self._target.rotation[1, 1])
        rim_y = max((y for bore in mate.bores for y in (bore.bottom_y, bore.top_y)), key=lambda y: y * seat_y)
        return abs(rim_y - tip_y)

    def seat_pose(self, sight: Sight) -> Pose:
        """Pose of the part once it is mounted."""
        return sight.part(self.mate_index) @ self._target

    def seat(self, sight: Sight) -> Seat:
        """How the part stands to its seat."""
        goal, part = self.seat_pose(sight), self.part(sight)
        x, y, z = (goal.rotation.T @ (part.position - goal.position)).tolist()
        return Seat(math.hypot(x, z), self._upwards * y, angle_between(part.rotation[:, 1], goal.rotation[:, 1]))

    def seat_point(self, sight: Sight, height_m: float) -> Vector:
        """Where the part's origin is when it stands ``height_m`` above its seat."""
        goal = self.seat_pose(sight)
        point: Vector = goal.position + height_m * self._upwards * goal.rotation[:, 1]
        return point

    def is_seated(self, sight: Sight) -> bool:
        """Whether the part is mounted."""
        return self._is_home(sight, _SEATED_COSINE)

    def is_tight(self, sight: Sight) -> bool:
        """Whether the part is screwed in so far that it stays mounted if it gives a little when it is let go."""
        return self._is_home(sight, _TIGHT_COSINE)

    def _is_home(self, sight: Sight, cosine: float) -> bool:
        goal, part = self.seat_pose(sight), self.part(sight)
        near = float(np.abs(goal.rotation.T @ (part.position - goal.position)).max()) < _SEATED_M
        return near and (self._any_rotation or float((goal.rotation * part.rotation).sum(axis=0).min()) > cosine)

    def is_engaged(self, sight: Sight) -> bool:
        """Whether its peg stands in its hole."""
        seat = self.seat(sight)
        low, high = _ENGAGED_HEIGHT_M
        return seat.aside_m < _ENGAGED_M and low < seat.height_m < high and seat.lean_rad < _ENGAGED_LEAN_RAD

    def upright(self, sight: Sight) -> Matrix:
        """Rotation of the part that stands on its mate, so turned that the end effector leads away from the robot.

        Led anywhere else, the wrist comes to the end of a joint, and the end effector no longer goes where it is told.
        """
        seated = self.seat_pose(sight).rotation
        held = self.part(sight).rotation.T @ sight.end_effector.rotation
        if self.handling.is_ball:
            rotation = self.part(sight).rotation
            rotation = turned(swing(rotation[:, 1], seated[:, 1]), rotation)
            return turned(-heading(rotation @ held[:, 2]) * UP, rotation)
        choices = [turned(quarter * math.pi / 2 * seated[:, 1], seated) for quarter in range(4)]
        if self.handling.lies:
            return max(choices, key=lambda rotation: float((rotation @ held[:, 2]) @ _FORWARDS))
        # An end effector that points down leads nowhere; its wrist is most at ease half-way through a stroke.
        return min(choices, key=lambda rotation: abs(wrapped(heading((rotation @ held)[:, 0]) - EASY_YAW_RAD)))

    def end_effector_yaw(self, sight: Sight) -> float:
        """Heading of the end effector's x axis [rad]."""
        return heading(sight.end_effector.rotation[:, 0])

    def hand_tilt(self, sight: Sight) -> float:
        """Angle between the end effector and straight down [rad]."""
        return angle_between(-sight.end_effector.rotation[:, 2], UP)

    def stroke_start(self, sight: Sight) -> float:
        """Yaw of the end effector, flat on the part's faces, from which a stroke takes about a quarter turn [rad]."""
        wanted = STROKE_END_RAD + math.pi / 2
        flat = heading(self.part(sight).rotation[:, 0]) + self.handling.flat_rad
        return wanted + wrapped(flat - wanted, self.handling.flat_every_rad)


def downward(yaw_rad: float) -> Matrix:
    """Rotation of an end effector that points straight down, its x axis in the direction of a yaw."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.array([[c, s, 0.0], [s, -c, 0.0], [0.0, 0.0, -1.0]])
