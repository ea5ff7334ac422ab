"""How the scripted operator takes hold of a part: data that a task's parts carry beside their geometry."""

from __future__ import annotations

import math
from dataclasses import dataclass

Row = tuple[float, float, float]
"""Of a rotation matrix."""


@dataclass(frozen=True)
class Handling:
    """Grasps of a part that is mounted on another, along its own y axis, which points away from its peg.

    Attributes:
        half_size_m: Half extents of a box around it.
        pick_m: Where along the axis it is picked up.
        pick_width_m: Its width there.
        pick_below_m: How much lower than the operator's habit it is picked up.
        pick_play_m: How far aside of it the open gripper may come down.
        is_ball: Whether it is grasped at a ball, and may stand at any yaw.
        screw_m: Where it is grasped to be screwed in, above its origin.
        screw_width_m: Its width there.
        flat_rad: Yaw of the part's x axis, relative to the end effector's, at which the fingers lie flat for a stroke.
        flat_every_rad: Turn after which they do again.
        turn_back_above_m: How high the open gripper goes to turn back past it.
        lies: Whether it lies on the table at first; else it stands.
        around_m: How far it goes around its mate, if it is put on.
        aligned_m: How far aside of its hole's axis it may enter it.
        clear_m: How far above its seat it must be lifted; a little more than it goes in if None.
    """

    half_size_m: tuple[float, float, float]
    pick_m: float
    pick_width_m: float
    screw_m: float
    screw_width_m: float
    flat_rad: float = 0.0
    flat_every_rad: float = math.pi / 2
    turn_back_above_m: float = 0.0
    lies: bool = True
    around_m: float = 0.0
    aligned_m: float = 0.0025
    clear_m: float | None = None
    pick_below_m: float = 0.0
    pick_play_m: float = 0.004
    is_ball: bool = False


@dataclass(frozen=True)
class BaseHandling:
    """How the first part is grasped to be pushed.

    Attributes:
        width_m: Its width between the fingers.
        height_m: Height of the grasp above the table; the operator's habit if None.
        rim_m: Distance of the grasp from the centre, towards the robot, on whichever side lies there.
        end_effector_yaw_rad: Yaw of the end effector, relative to the part.
        straight: Rotation of the part when it is not turned, by rows.
        symmetry_rad: Turn after which it looks the same to whoever pushes it.
    """

    width_m: float
    height_m: float | None
    rim_m: float
    end_effector_yaw_rad: float
    straight: tuple[Row, Row, Row]
    symmetry_rad: float


Y_UP = ((0.0, 0.0, -1.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
Y_DOWN = ((0.0, 0.0, -1.0), (1.0, 0.0, 0.0), (0.0, -1.0, 0.0))
"""Rotations, by rows, of a first part whose y axis points up or down, when it is not turned."""
