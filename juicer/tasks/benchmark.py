"""What all parts of FurnitureBench have in common: units, frames, the screw thread, round plates."""

from __future__ import annotations

import math

from juicer.tasks.specification import Box, Pose

MM = 1e-3
PITCH = 9.375 * MM
TURNS = 2.0
BEAD_RADIUS = 2.1875 * MM
PEG_RADIUS = 10.0 * MM
"""Of the shaft, and of the helix on which the centres of its bead lie."""
BORE_RADIUS = 12.5 * MM
HOLE_HELIX_RADIUS = 13.125 * MM

# World positions of the benchmark, moved into the robot base frame (base at world x -0.3, z 0.43).
_BASE_X, _BASE_Z = -0.3, 0.43


def base_pose(world_x: float, world_y: float, world_z: float, *quat_wxyz: float) -> Pose:
    """Pose in the robot base frame of a pose that the benchmark gives in its world frame."""
    w, x, y, z = quat_wxyz
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    return (world_x - _BASE_X, world_y, world_z - _BASE_Z, w / norm, x / norm, y / norm, z / norm)


def upright_pose(world_x: float, world_y: float, world_z: float, *quat_wxyz: float) -> Pose:
    """The same for a part whose axis is z in the benchmark: here it is y, as every part's."""
    x, y, z, qw, qx, qy, qz = base_pose(world_x, world_y, world_z, *quat_wxyz)
    half = math.sqrt(0.5)
    # Right-multiplied by a quarter turn about x, which takes our y axis to the benchmark's z axis.
    return (x, y, z, half * (qw - qx), half * (qx + qw), half * (qy + qz), half * (qz - qy))


def round_plate(radius: float, bottom_y: float, top_y: float, boxes: int) -> tuple[Box, ...]:
    """Disc about the y axis as a star of boxes: a polygon of twice as many sides, ``radius`` to their middles."""
    half = (radius, (top_y - bottom_y) / 2, radius * math.tan(math.pi / (2 * boxes)))
    return tuple(Box((0.0, (bottom_y + top_y) / 2, 0.0), half, index * math.pi / boxes) for index in range(boxes))


def axis_turn(degrees: float) -> tuple[float, float, float, float]:
    """Quaternion wxyz of a turn about the y axis."""
    return (math.cos(math.radians(degrees) / 2), 0.0, math.sin(math.radians(degrees) / 2), 0.0)
