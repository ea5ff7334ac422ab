"""round_table: a leg into the hub of a round top, a cross-shaped base onto the leg; from FurnitureBench's meshes.

The axis of every part is y here; the benchmark's top and base have it at z, so their frames are turned by 90 degrees
about x. Deviations from the measured facts, each for a reason:

* The top is a polygon of 24 sides and rests on six balls that stand out by 0.2 mm: a disc of panels would touch the
  table in a hundred points.
* Parts with a peg rest on their hole's rim with six balls that stand out by 0.2 mm, see :func:`shoulder`.
* The hole of the top is turned by 41 degrees, so that its hard stop lies at the nominal yaw. As measured, the original
  reaches the nominal yaw only by penetration.
* The leg's grip zone is a plain square of 32.5 mm (its corners stand out of the round head by 1.7 mm).
* The base's arms taper in two steps, and its centre is a square of 40.04 mm across the diagonals of the cross.
"""

from __future__ import annotations

import math

from juicer.tasks.furniture_bench import (
    BLUE,
    BORE_RADIUS,
    MM,
    PEG_RADIUS,
    WHITE,
    axis_turn,
    base_pose,
    feet,
    inner_thread,
    outer_thread,
    pointer,
    round_plate,
    shoulder,
    tags,
    upright_pose,
)
from juicer.tasks.handling import Y_UP, BaseHandling, Handling
from juicer.tasks.specification import (
    AssemblyPair,
    AssemblyTask,
    Bore,
    Box,
    Grasp,
    Insertion,
    Mark,
    PartSpec,
    Peg,
    Shell,
)


def _top() -> PartSpec:
    return PartSpec(
        name="round_table_top",
        mass=0.1235,
        center_of_mass=(0.0, 5.12 * MM, 0.0),
        inertia=(337e-6, 664e-6, 337e-6),
        start=upright_pose(0.2415, 0.0, 0.4165, math.sqrt(0.5), 0.0, 0.0, -math.sqrt(0.5)),
        footprint=(0.2, 0.2),
        is_round=True,
        start_shift_m=(-0.05, 0.01),
        rgb=(0.82, 0.80, 0.75),
        boxes=round_plate(94.0 * MM, -1.25 * MM, 5.0 * MM, 4),
        balls=feet(85.0 * MM, -1.25 * MM, 6),
        shells=(Shell(-1.25 * MM, 17.5 * MM, 93.75 * MM, 93.75 * MM, 6.25 * MM, 24),),
        bores=(Bore((0.0, 0.0), BORE_RADIUS, 21.25 * MM, 5.0 * MM, 31.25 * MM),),
        threads=(inner_thread(5.0 * MM, -130.7),),
        handling=BaseHandling(
            width_m=0.0425,
            height_m=0.026,
            rim_m=0.0,
            end_effector_yaw_rad=0.0,
            straight=Y_UP,
            symmetry_rad=math.pi / 12,
        ),
    )


def _leg() -> PartSpec:
    return PartSpec(
        name="round_table_leg",
        mass=0.033,
        center_of_mass=(0.0, 13.0 * MM, 0.0),
        inertia=(20.25e-6, 6.93e-6, 20.25e-6),
        start=base_pose(0.1015, 0.13, 0.4363, 0.0, math.sqrt(0.5), math.sqrt(0.5), 0.0),
        footprint=(0.09125, 0.0425),
        rgb=(0.80, 0.50, 0.28),
        boxes=(
            Box((0.0, 0.0, 0.0), (16.25 * MM, 13.125 * MM, 16.25 * MM)),
            Box((0.0, 18.75 * MM, 0.0), (13.5 * MM, 5.625 * MM, 13.5 * MM)),
        ),
        balls=shoulder(-13.125 * MM),
        pegs=(Peg(PEG_RADIUS, -39.375 * MM, -13.125 * MM),),
        bores=(Bore((0.0, 0.0), BORE_RADIUS, 21.25 * MM, 13.125 * MM, 51.875 * MM),),
        threads=(outer_thread(-31.875 * MM, 90.0), inner_thread(24.375 * MM, -90.0)),
        marks=(*tags(16.25 * MM, 12.0 * MM), pointer(51.875 * MM, 12.5 * MM, 21.0 * MM)),
        handling=Handling(
            half_size_m=(0.0213, 0.052, 0.0213),
            pick_m=0.034,
            pick_width_m=0.0425,
            screw_m=0.032,
            screw_width_m=0.0425,
            flat_every_rad=math.pi / 6,
        ),
    )


def _base() -> PartSpec:
    quarter = math.pi / 2
    arm = ((65.0 * MM, 6.25 * MM, 10.5 * MM), (12.0 * MM, 6.25 * MM, 15.0 * MM))
    tips = tuple(
        Box((53.0 * MM * math.cos(angle), 5.0 * MM, -53.0 * MM * math.sin(angle)), arm[1], angle)
        for angle in (0.0, quarter, 2 * quarter, 3 * quarter)
    )
    return PartSpec(
        name="round_table_base",
        mass=0.0437,
        center_of_mass=(0.0, 2.6 * MM, 0.0),
        inertia=(34.3e-6, 63.4e-6, 34.3e-6),
        start=upright_pose(0.1215, -0.12, 0.4438, math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)),
        footprint=(0.134, 0.134),
        is_round=True,
        rgb=(0.55, 0.62, 0.70),
        boxes=(
            Box((0.0, 5.0 * MM, 0.0), (20.02 * MM, 6.25 * MM, 20.02 * MM), quarter / 2),
            Box((0.0, 5.0 * MM, 0.0), arm[0]),
            Box((0.0, 5.0 * MM, 0.0), arm[0], quarter),
            *tips,
        ),
        balls=shoulder(-1.25 * MM),
        pegs=(Peg(PEG_RADIUS, -28.75 * MM, -1.25 * MM),),
        threads=(outer_thread(-20.0 * MM, -90.0),),
        marks=(
            Mark(Box((52.0 * MM, 5.0 * MM, 0.0), (8.0 * MM, 6.35 * MM, 10.0 * MM)), BLUE),
            Mark(Box((0.0, 5.0 * MM, 52.0 * MM), (10.0 * MM, 6.35 * MM, 8.0 * MM)), WHITE),
        ),
        handling=Handling(
            half_size_m=(0.065, 0.029, 0.065),
            pick_m=0.004,
            pick_width_m=0.0468,
            screw_m=0.004,
            screw_width_m=0.0468,
            flat_rad=math.pi / 4,
            turn_back_above_m=0.04,
            lies=False,
            pick_play_m=0.0022,
        ),
    )


_PARTS = (_top(), _leg(), _base())

# FurnitureBench's three stored layouts of high randomness (world frame, quaternion wxyz).
_HIGH = (
    (
        upright_pose(0.2175, 0.0470, 0.4170, 0.763, -0.005, 0.009, -0.646),
        base_pose(0.2645, -0.1180, 0.4540, 0.797, -0.154, -0.224, -0.539),
        upright_pose(0.1105, -0.1350, 0.4450, 0.542, 0.016, 0.007, 0.840),
    ),
    (
        upright_pose(0.1915, -0.0770, 0.4170, 0.923, 0.004, 0.006, -0.384),
        base_pose(0.3025, 0.0660, 0.4350, 0.027, 0.204, -0.975, -0.088),
        upright_pose(0.1615, 0.1240, 0.4490, 0.370, 0.011, 0.001, 0.929),
    ),
    (
        upright_pose(0.1255, 0.0760, 0.4180, 0.804, 0.011, 0.017, 0.595),
        base_pose(0.1565, -0.0900, 0.4370, 0.491, 0.019, -0.072, -0.868),
        upright_pose(0.2945, -0.0070, 0.4440, 0.792, 0.009, 0.003, 0.610),
    ),
)

TASK = AssemblyTask(
    name="round_table",
    parts=_PARTS,
    base_label="top",
    pairs=(
        AssemblyPair("leg", 0, 1, ((0.0, 44.375 * MM, 0.0, *axis_turn(185.0)),)),
        AssemblyPair("base", 1, 2, ((0.0, 53.125 * MM, 0.0, *axis_turn(90.0)),)),
    ),
    high_layouts=_HIGH,
    max_steps=2000,
    critical_states=(Insertion(0), Grasp(2), Insertion(1)),
    gripper_width_m=0.065,
)
