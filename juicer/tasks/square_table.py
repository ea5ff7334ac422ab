"""Parts of FurnitureBench's square table, as measured from its meshes.

Deviations from the measured facts, each for a reason:

* Legs are centred on their own axis (the meshes sit up to 0.6 mm off): a bias of the size of the clearance.
* The 1.25 mm deep AprilTag pockets and engravings are filled: a leg is 30 mm across flats everywhere.
* All four legs carry leg 4's thread phase, whose hard stop lies at the nominal yaw (leg 1's would overlap).
"""

from __future__ import annotations

import math

from juicer.tasks.specification import Bore, Box, PartSpec, Peg, Pose, Thread

MM = 1e-3
PITCH = 9.375 * MM
BEAD_RADIUS = 2.1875 * MM
HOLE_OFFSET = 56.25 * MM
HOLES_XZ = tuple((sx * HOLE_OFFSET, sz * HOLE_OFFSET) for sx in (-1, 1) for sz in (-1, 1))
"""Axes of the four holes in the top's frame, in the order of the assembled poses."""

ASSEMBLED_LEG_POSES: tuple[Pose, ...] = tuple((x, 46.875 * MM, z, 1.0, 0.0, 0.0, 0.0) for x, z in HOLES_XZ)
"""Assembled poses of a leg in the top's frame: any hole, identity rotation only."""

_PLATE_BOTTOM, _PLATE_TOP, _RIM_TOP = -15.685 * MM, -9.435 * MM, 15.565 * MM
_HALF_WIDTH, _WALL = 81.25 * MM, 6.25 * MM

# World positions of the benchmark, moved into the robot base frame (base at world x -0.3, z 0.43).
_BASE_X, _BASE_Z = -0.3, 0.43
_HALF_SQRT = math.sqrt(0.5)


def base_pose(world_x: float, world_y: float, world_z: float, *quat_wxyz: float) -> Pose:
    """Pose in the robot base frame of a pose that the benchmark gives in its world frame."""
    w, x, y, z = quat_wxyz
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    return (world_x - _BASE_X, world_y, world_z - _BASE_Z, w / norm, x / norm, y / norm, z / norm)


def _rim() -> tuple[Box, ...]:
    mid_y, half_y = (_PLATE_TOP + _RIM_TOP) / 2, (_RIM_TOP - _PLATE_TOP) / 2
    reach = _HALF_WIDTH - _WALL / 2
    inner = _HALF_WIDTH - _WALL
    return (
        Box((reach, mid_y, 0.0), (_WALL / 2, half_y, _HALF_WIDTH)),
        Box((-reach, mid_y, 0.0), (_WALL / 2, half_y, _HALF_WIDTH)),
        Box((0.0, mid_y, reach), (inner, half_y, _WALL / 2)),
        Box((0.0, mid_y, -reach), (inner, half_y, _WALL / 2)),
    )


def square_table_top() -> PartSpec:
    """Tray with a rim and four threaded bosses; +y is the open side, up when it lies on the table."""
    plate = Box(
        (0.0, (_PLATE_BOTTOM + _PLATE_TOP) / 2, 0.0), (_HALF_WIDTH, (_PLATE_TOP - _PLATE_BOTTOM) / 2, _HALF_WIDTH)
    )
    return PartSpec(
        name="square_table_top",
        mass=0.151,
        center_of_mass=(0.0, -5.52 * MM, 0.0),
        inertia=(457.6e-6, 889.7e-6, 457.6e-6),
        start=base_pose(0.2415, 0.0, 0.4306, 0.5, 0.5, -0.5, -0.5),
        footprint=(0.1625, 0.1625),
        rgb=(0.82, 0.80, 0.75),
        boxes=(plate, *_rim()),
        bores=tuple(Bore(hole, 12.5 * MM, 16.25 * MM, _PLATE_TOP, _RIM_TOP) for hole in HOLES_XZ),
        threads=tuple(
            Thread(hole, _PLATE_TOP, 0.0, 2.0, PITCH, 13.125 * MM, BEAD_RADIUS, internal=True) for hole in HOLES_XZ
        ),
    )


def square_table_leg(number: int, world_y: float, rgb: tuple[float, float, float]) -> PartSpec:
    """Square leg with a threaded peg at -y, lying on the table with the peg towards the robot."""
    return PartSpec(
        name=f"square_table_leg{number}",
        mass=0.0231,
        center_of_mass=(0.0, -6.75 * MM, 0.0),
        inertia=(14.0e-6, 3.0e-6, 14.0e-6),
        start=base_pose(0.0715, world_y, 0.430, 0.5, 0.5, 0.5, -0.5),
        footprint=(0.0875, 0.05),
        rgb=rgb,
        boxes=(Box((0.0, 0.0, 0.0), (15.0 * MM, 31.25 * MM, 15.0 * MM)),),
        pegs=(Peg(10.0 * MM, -56.25 * MM, -31.25 * MM),),
        threads=(Thread((0.0, 0.0), -50.0 * MM, 0.0, 2.0, PITCH, 10.0 * MM, BEAD_RADIUS, internal=False),),
    )
