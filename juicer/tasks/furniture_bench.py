"""What all parts of FurnitureBench have in common: units, frames, the screw thread, round plates."""

from __future__ import annotations

import math

from juicer.tasks.specification import Ball, Box, Mark, PoseValues, Thread

MM = 1e-3
PITCH = 9.375 * MM
TURNS = 2.0
BEAD_RADIUS = 2.1875 * MM
PEG_RADIUS = 10.0 * MM
"""Of the shaft, and of the helix on which the centres of its bead lie."""
BORE_RADIUS = 12.5 * MM
HOLE_HELIX_RADIUS = 13.125 * MM

TAG_HALF_WIDTH = 13.125 * MM
"""Of the square pockets for AprilTags."""
BLUE, WHITE = (0.08, 0.20, 0.62), (0.96, 0.96, 0.96)
_PROUD = 0.1 * MM

_FOOT_RADIUS, _FOOT_OUT = 2.0 * MM, 0.2 * MM
_RIM_MIDDLE = 14.4 * MM

# World positions of the benchmark, moved into the robot base frame (base at world x -0.3, z 0.43).
_BASE_X, _BASE_Z = -0.3, 0.43


def base_pose(world_x: float, world_y: float, world_z: float, *quat_wxyz: float) -> PoseValues:
    """PoseValues in the robot base frame of a pose that the benchmark gives in its world frame."""
    w, x, y, z = quat_wxyz
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    return (world_x - _BASE_X, world_y, world_z - _BASE_Z, w / norm, x / norm, y / norm, z / norm)


def upright_pose(world_x: float, world_y: float, world_z: float, *quat_wxyz: float) -> PoseValues:
    """The same for a part whose axis is z in the benchmark: here it is y, as every part's."""
    x, y, z, qw, qx, qy, qz = base_pose(world_x, world_y, world_z, *quat_wxyz)
    half = math.sqrt(0.5)
    # Right-multiplied by a quarter turn about x, which takes our y axis to the benchmark's z axis.
    return (x, y, z, half * (qw - qx), half * (qx + qw), half * (qy + qz), half * (qz - qy))


def round_plate(radius: float, bottom_y: float, top_y: float, boxes: int) -> tuple[Box, ...]:
    """Disc about the y axis as a star of boxes: a polygon of twice as many sides, ``radius`` to their middles."""
    half = (radius, (top_y - bottom_y) / 2, radius * math.tan(math.pi / (2 * boxes)))
    return tuple(Box((0.0, (bottom_y + top_y) / 2, 0.0), half, index * math.pi / boxes) for index in range(boxes))


def feet(radius: float, bottom_y: float, count: int) -> tuple[Ball, ...]:
    """Ring of balls, slightly proud of a flat face that looks along -y, on which a part stands without rocking."""
    angles = (2 * math.pi * index / count for index in range(count))
    y = bottom_y + _FOOT_RADIUS - _FOOT_OUT
    return tuple(Ball((radius * math.sin(angle), y, radius * math.cos(angle)), _FOOT_RADIUS) for angle in angles)


def shoulder(bottom_y: float) -> tuple[Ball, ...]:
    """Feet around a peg, with which a part comes to rest on the rim of its hole.

    A flat box on a ring of boxes makes some 50 contacts where six do; four such legs cost ten times the physics.
    """
    return feet(_RIM_MIDDLE, bottom_y, 6)


def axis_turn(degrees: float) -> tuple[float, float, float, float]:
    """Quaternion wxyz of a turn about the y axis."""
    return (math.cos(math.radians(degrees) / 2), 0.0, math.sin(math.radians(degrees) / 2), 0.0)


def inner_thread(
    start_y: float, azimuth_deg: float, center_xz: tuple[float, float] = (0.0, 0.0), bead_radius: float = BEAD_RADIUS
) -> Thread:
    """Bead that lines a hole, from its lower end."""
    azimuth = math.radians(azimuth_deg)
    return Thread(center_xz, start_y, azimuth, TURNS, PITCH, HOLE_HELIX_RADIUS, bead_radius, internal=True)


def outer_thread(start_y: float, azimuth_deg: float) -> Thread:
    """Bead that winds around a peg, from its lower end."""
    return Thread((0.0, 0.0), start_y, math.radians(azimuth_deg), TURNS, PITCH, PEG_RADIUS, BEAD_RADIUS, internal=False)


def tags(distance: float, half_width: float) -> tuple[Mark, ...]:
    """What tells the four sides of a square grip zone apart, where the benchmark's parts carry their AprilTags.

    A blue square at +z, a white one at +x, a blue bar at -z, a white one at -x.

    Args:
        distance: Of the sides from the part's axis.
        half_width: Of the squares.
    """
    bar = half_width / 4
    return (
        Mark(Box((0.0, 0.0, distance), (half_width, TAG_HALF_WIDTH, _PROUD)), BLUE),
        Mark(Box((distance, 0.0, 0.0), (_PROUD, TAG_HALF_WIDTH, half_width)), WHITE),
        Mark(Box((0.0, 0.0, -distance), (bar, TAG_HALF_WIDTH, _PROUD)), BLUE),
        Mark(Box((-distance, 0.0, 0.0), (_PROUD, TAG_HALF_WIDTH, bar)), WHITE),
    )


def pointer(y: float, near: float, far: float) -> Mark:
    """A blue stripe on a face at right angles to the axis, from the axis towards +z."""
    return Mark(Box((0.0, y, (near + far) / 2), (3.0 * MM, _PROUD, (far - near) / 2)), BLUE)
