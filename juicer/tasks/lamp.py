"""lamp: a bulb into its base, a hood over both. Measured from FurnitureBench's meshes; every part's axis is y.

The base stands with -y up. Deviations from the measured facts, each for a reason:

* The base's flare is three boxes, its stem the wall of the bore; the fillet under the flange is left out.
* The bulb's sphere is solid, its collar the square grip zone; the tip of its peg is not rounded.
* Parts with a peg rest on their hole's rim with six balls that stand out by 0.2 mm, see :func:`shoulder`.
* The hood is a cone of 16 panels without the flats for tags.
"""

from __future__ import annotations

import math

from juicer.tasks.furniture_bench import (
    BORE_RADIUS,
    MM,
    PEG_RADIUS,
    axis_turn,
    base_pose,
    inner_thread,
    outer_thread,
    pointer,
    shoulder,
    tags,
)
from juicer.tasks.handling import Y_DOWN, BaseHandling, Handling
from juicer.tasks.specification import (
    AssemblyPair,
    AssemblyTask,
    Ball,
    Bore,
    Box,
    Grasp,
    Insertion,
    Joint,
    PartSpec,
    Peg,
    Shell,
)

_SMALLER_BEAD = 1.9375 * MM


def _square(half_width: float, low_y: float, high_y: float) -> Box:
    return Box((0.0, (low_y + high_y) / 2, 0.0), (half_width, (high_y - low_y) / 2, half_width))


def _flange(half_width: float, hole: float, low_y: float, high_y: float) -> tuple[Box, ...]:
    """Square plate with a square hole, as four boxes."""
    middle, half = (half_width + hole) / 2, (half_width - hole) / 2
    y, half_y = (low_y + high_y) / 2, (high_y - low_y) / 2
    return (
        Box((middle, y, 0.0), (half, half_y, half_width)),
        Box((-middle, y, 0.0), (half, half_y, half_width)),
        Box((0.0, y, middle), (hole, half_y, half)),
        Box((0.0, y, -middle), (hole, half_y, half)),
    )


def _base() -> PartSpec:
    return PartSpec(
        name="lamp_base",
        mass=0.0597,
        center_of_mass=(0.0, -0.84 * MM, 0.0),
        inertia=(43.5e-6, 52.4e-6, 43.5e-6),
        start=base_pose(0.1415, 0.05, 0.4322, 0.5, -0.5, -0.5, 0.5),
        footprint=(0.0847, 0.0847),
        rgb=(0.82, 0.80, 0.75),
        boxes=(
            _square(42.35 * MM, 7.2 * MM, 17.2 * MM),
            _square(36.0 * MM, 2.0 * MM, 7.2 * MM),
            _square(29.0 * MM, -4.0 * MM, 2.0 * MM),
            _square(23.0 * MM, -14.8 * MM, -4.0 * MM),
            *_flange(27.575 * MM, 14.5 * MM, -45.8 * MM, -40.8 * MM),
        ),
        bores=(Bore((0.0, 0.0), BORE_RADIUS, 16.25 * MM, -45.8 * MM, -14.8 * MM),),
        threads=(inner_thread(-39.55 * MM, 180.0, bead_radius=_SMALLER_BEAD),),
        marks=(pointer(-45.8 * MM, 16.5 * MM, 27.575 * MM),),
        handling=BaseHandling(
            width_m=0.0555,
            height_m=0.058,
            rim_m=0.0,
            end_effector_yaw_rad=0.0,
            straight=Y_DOWN,
            symmetry_rad=math.pi / 2,
        ),
    )


def _bulb() -> PartSpec:
    return PartSpec(
        name="lamp_bulb",
        mass=0.0385,
        center_of_mass=(0.0, -0.13 * MM, 0.0),
        inertia=(32.1e-6, 10.6e-6, 32.1e-6),
        start=base_pose(0.1315, 0.18, 0.4345, 0.051, 0.705, 0.705, 0.051),
        footprint=(0.13, 0.057),
        rgb=(0.95, 0.85, 0.45),
        boxes=(_square(17.5 * MM, -13.125 * MM, 13.125 * MM),),
        balls=(Ball((0.0, 38.0 * MM, 0.0), 30.0 * MM), *shoulder(-13.125 * MM)),
        pegs=(Peg(PEG_RADIUS, -53.0 * MM, -13.0 * MM),),
        threads=(outer_thread(-40.75 * MM, 180.0),),
        marks=tags(17.5 * MM, 13.0 * MM),
        rolls=True,
        handling=Handling(
            half_size_m=(0.030, 0.060, 0.030),
            pick_m=0.038,
            pick_width_m=0.0595,
            screw_m=0.038,
            screw_width_m=0.0595,
            flat_every_rad=math.pi / 36,
            pick_below_m=0.008,
            pick_play_m=0.003,
            is_ball=True,
        ),
    )


def _hood() -> PartSpec:
    return PartSpec(
        name="lamp_hood",
        mass=0.060,
        center_of_mass=(0.0, 2.24 * MM, 0.0),
        inertia=(92.9e-6, 76.5e-6, 92.9e-6),
        start=base_pose(0.1615, -0.12, 0.4638, 0.5, -0.5, -0.5, 0.5),
        footprint=(0.088, 0.088),
        rgb=(0.55, 0.62, 0.70),
        shells=(Shell(-51.417 * MM, 48.583 * MM, 26.0 * MM, 40.0 * MM, 4.0 * MM, 16),),
        handling=Handling(
            half_size_m=(0.044, 0.050, 0.044),
            pick_m=-0.046,
            pick_width_m=0.0655,
            screw_m=-0.046,
            screw_width_m=0.0655,
            flat_every_rad=math.pi / 8,
            lies=False,
            around_m=0.0065,
            aligned_m=0.0012,
            clear_m=0.105,
            pick_play_m=0.002,
        ),
    )


_PARTS = (_base(), _bulb(), _hood())

# FurnitureBench's three stored layouts of high randomness (world frame, quaternion wxyz).
_HIGH = (
    (
        base_pose(0.2065, -0.1290, 0.4350, 0.392, -0.374, -0.590, 0.598),
        base_pose(0.2920, 0.0743, 0.4486, 0.076, 0.980, -0.027, 0.183),
        base_pose(0.1425, 0.0840, 0.4680, 0.476, -0.475, 0.529, -0.517),
    ),
    (
        base_pose(0.2615, -0.0300, 0.4340, 0.629, -0.623, -0.327, 0.331),
        base_pose(0.1575, 0.0770, 0.4380, 0.035, -0.746, -0.654, -0.121),
        base_pose(0.1215, -0.0880, 0.4650, 0.582, -0.529, 0.429, -0.444),
    ),
    (
        base_pose(0.2495, -0.0720, 0.4340, 0.650, -0.644, -0.282, 0.288),
        base_pose(0.1592, 0.0368, 0.4388, 0.130, 0.918, 0.348, -0.136),
        base_pose(0.2855, 0.0810, 0.4670, 0.620, -0.622, 0.343, -0.332),
    ),
)

TASK = AssemblyTask(
    name="lamp",
    parts=_PARTS,
    base_label="base",
    pairs=(
        AssemblyPair("bulb", 0, 1, ((0.0, -67.8 * MM, 0.0, 0.0, 0.0, 0.0, 1.0),)),
        AssemblyPair(
            "hood",
            0,
            2,
            ((0.0, -88.324 * MM, 0.0, *axis_turn(0.0)),),
            joint=Joint.PUT_ON,
            any_rotation=True,
            after=(0,),
        ),
    ),
    high_layouts=_HIGH,
    max_steps=2000,
    critical_states=(Grasp(0), Grasp(1), Insertion(0), Grasp(2), Insertion(1)),
    gripper_width_m=0.07,
)
