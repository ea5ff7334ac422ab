"""square_table: four legs to be screwed into a tray-shaped top. Its parts, as measured from FurnitureBench's meshes.

Deviations from the measured facts, each for a reason:

* Legs are centred on their own axis (the meshes sit up to 0.6 mm off): a bias of the size of the clearance.
* The 1.25 mm deep AprilTag pockets and engravings are filled: a leg is 30 mm across flats everywhere.
* Parts with a peg rest on their hole's rim with six balls that stand out by 0.2 mm, see :func:`shoulder`.
* All four legs carry leg 4's thread phase, whose hard stop lies at the nominal yaw (leg 1's would overlap).
"""

from __future__ import annotations

import math

from juicer.tasks.furniture_bench import MM, base_pose, inner_thread, outer_thread, pointer, shoulder, tags
from juicer.tasks.handling import Y_UP, BaseHandling, Handling
from juicer.tasks.specification import AssemblyPair, AssemblyTask, Bore, Box, Insertion, PartSpec, Peg, PoseValues

HOLE_OFFSET = 56.25 * MM
HOLES_XZ = tuple((sx * HOLE_OFFSET, sz * HOLE_OFFSET) for sx in (-1, 1) for sz in (-1, 1))
"""Axes of the four holes in the top's frame, in the order of the assembled poses."""

ASSEMBLED_LEG_POSES: tuple[PoseValues, ...] = tuple((x, 46.875 * MM, z, 1.0, 0.0, 0.0, 0.0) for x, z in HOLES_XZ)
"""Assembled poses of a leg in the top's frame: any hole, identity rotation only."""

_PLATE_BOTTOM, _PLATE_TOP, _RIM_TOP = -15.685 * MM, -9.435 * MM, 15.565 * MM
_HALF_WIDTH, _WALL = 81.25 * MM, 6.25 * MM


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
        threads=tuple(inner_thread(_PLATE_TOP, 0.0, hole) for hole in HOLES_XZ),
        handling=BaseHandling(
            width_m=0.00625,
            height_m=None,
            rim_m=0.078125,
            end_effector_yaw_rad=math.pi / 2,
            straight=Y_UP,
            symmetry_rad=math.pi / 2,
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
        balls=shoulder(-31.25 * MM),
        pegs=(Peg(10.0 * MM, -56.25 * MM, -31.25 * MM),),
        threads=(outer_thread(-50.0 * MM, 0.0),),
        marks=(*tags(15.0 * MM, 11.0 * MM), pointer(31.25 * MM, 0.0, 15.0 * MM)),
        handling=Handling(
            half_size_m=(0.015, 0.056, 0.015), pick_m=0.0115, pick_width_m=0.030, screw_m=0.012, screw_width_m=0.030
        ),
    )


SQUARE_TABLE_PARTS = (
    square_table_top(),
    square_table_leg(1, -0.20, (0.55, 0.62, 0.70)),
    square_table_leg(2, -0.12, (0.55, 0.62, 0.70)),
    square_table_leg(3, 0.12, (0.55, 0.62, 0.70)),
    square_table_leg(4, 0.20, (0.80, 0.50, 0.28)),
)

# FurnitureBench's three stored layouts of high randomness (world frame, quaternion wxyz).
HIGH_LAYOUTS = (
    (
        base_pose(0.2332, 0.0017, 0.4307, 0.701, 0.705, -0.081, -0.077),
        base_pose(0.1740, 0.1241, 0.4300, 0.754, -0.003, 0.004, -0.657),
        base_pose(0.1500, 0.1491, 0.4383, 0.004, -0.648, -0.761, 0.001),
        base_pose(0.1895, -0.1195, 0.4324, 0.469, -0.542, -0.449, -0.534),
        base_pose(0.1288, -0.1531, 0.4333, 0.442, -0.006, 0.005, -0.897),
    ),
    (
        base_pose(0.2105, -0.0207, 0.4307, 0.700, 0.708, 0.063, 0.071),
        base_pose(0.1702, 0.1141, 0.4301, 0.014, -0.748, -0.664, 0.006),
        base_pose(0.2095, -0.0462, 0.4340, 0.000, -0.706, -0.708, 0.000),
        base_pose(0.0991, 0.2111, 0.4312, 0.446, 0.544, 0.454, -0.547),
        base_pose(0.2546, -0.1481, 0.4317, 0.514, -0.013, 0.010, -0.857),
    ),
    (
        base_pose(0.1401, -0.0737, 0.4322, 0.695, 0.697, -0.129, -0.123),
        base_pose(0.1628, 0.0707, 0.4313, 0.341, 0.615, 0.347, -0.621),
        base_pose(0.3183, -0.0781, 0.4300, 0.386, 0.589, 0.388, -0.595),
        base_pose(0.1021, 0.1526, 0.4308, 0.635, -0.011, 0.015, -0.773),
        base_pose(0.2820, 0.0850, 0.4315, 0.033, 0.701, 0.040, -0.711),
    ),
)


def leg_pair(number: int, label: str, hole: int) -> AssemblyPair:
    """Leg of a number in any hole; demonstrators aim at one of :data:`HOLES_XZ`."""
    return AssemblyPair(label=label, first=0, second=number, targets=ASSEMBLED_LEG_POSES, operator_target=hole)


# In the benchmark's order. The holes farthest from the robot come first, so that no standing leg is in the way.
TASK = AssemblyTask(
    name="square_table",
    parts=SQUARE_TABLE_PARTS,
    base_label="top",
    pairs=(leg_pair(4, "leg4", 0), leg_pair(3, "leg3", 2), leg_pair(1, "leg1", 1), leg_pair(2, "leg2", 3)),
    high_layouts=HIGH_LAYOUTS,
    max_steps=4000,
    critical_states=tuple(Insertion(pair) for pair in range(4)),
    gripper_width_m=0.065,
)
