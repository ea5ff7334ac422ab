"""Vocabulary in which an assembly task is written down. Data only: no physics, no policy.

Lengths are metres, masses kilograms, angles radians. A part frame is the one of FurnitureBench's part;
poses are ``(x, y, z, qw, qx, qy, qz)``. Positions on the table are in the robot base frame (x forward,
y to the robot's left, z up), in which the table's surface lies at :data:`TABLE_HEIGHT_M`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from juicer.errors import ConfigError, did_you_mean

Vector = tuple[float, float, float]
Pose = tuple[float, float, float, float, float, float, float]

TABLE_HEIGHT_M = -0.015
IDENTITY_QUAT = (1.0, 0.0, 0.0, 0.0)


class Randomness(StrEnum):
    """How far the initial state may stray (FurnitureBench's levels)."""

    LOW = "low"
    MED = "med"
    HIGH = "high"


def parse_randomness(text: str) -> Randomness:
    """Level of randomness by name.

    Raises:
        ConfigError: If there is no such level.
    """
    try:
        return Randomness(text)
    except ValueError:
        raise ConfigError(f"unknown randomness '{text}'{did_you_mean(text, Randomness)}") from None


@dataclass(frozen=True)
class Box:
    """Solid box, axes along the part's."""

    center: Vector
    half_size: Vector


@dataclass(frozen=True)
class Peg:
    """Cylinder along the part's y axis with a flat tip at ``tip_y``, reaching up to ``root_y``."""

    radius: float
    tip_y: float
    root_y: float


@dataclass(frozen=True)
class Bore:
    """Tube around a hole along the part's y axis, open at ``top_y``."""

    center_xz: tuple[float, float]
    inner_radius: float
    outer_radius: float
    bottom_y: float
    top_y: float


@dataclass(frozen=True)
class Thread:
    """Right-handed helical bead of circular section about an axis parallel to the part's y axis.

    Attributes:
        center_xz: Where the axis meets the part's xz plane.
        start_y: Height of the centreline's lower end.
        start_azimuth_rad: Its azimuth there, from +z towards +x.
        turns: Number of turns.
        pitch: Rise of one turn.
        helix_radius: Distance of the centreline from the axis.
        bead_radius: Radius of the bead's section.
        internal: Whether it lines a hole (else it winds around a peg).
    """

    center_xz: tuple[float, float]
    start_y: float
    start_azimuth_rad: float
    turns: float
    pitch: float
    helix_radius: float
    bead_radius: float
    internal: bool


@dataclass(frozen=True)
class PartSpec:
    """One rigid part.

    Attributes:
        name: Unique name.
        mass: Kilograms.
        center_of_mass: In the part frame.
        inertia: Principal moments about the centre of mass, along the part's axes [kg m^2].
        boxes, pegs, bores, threads: Its geometry.
        start: Mean initial pose in the robot base frame.
        footprint: Extents (x, y) of the rectangle that keeps other parts away at reset.
        rgb: Colour, each channel in [0, 1].
    """

    name: str
    mass: float
    center_of_mass: Vector
    inertia: Vector
    start: Pose
    footprint: tuple[float, float]
    rgb: Vector
    boxes: tuple[Box, ...] = ()
    pegs: tuple[Peg, ...] = ()
    bores: tuple[Bore, ...] = ()
    threads: tuple[Thread, ...] = ()


@dataclass(frozen=True)
class AssemblyPair:
    """Two parts that belong together.

    Attributes:
        first: Index of the reference part.
        second: Index of the part mounted on it.
        targets: Poses of the second in the first's frame, any of which counts.
        operator_target: Index of the target that demonstrators aim at.
    """

    first: int
    second: int
    targets: tuple[Pose, ...]
    operator_target: int


@dataclass(frozen=True)
class AssemblyTask:
    """Everything that distinguishes one task from another.

    Attributes:
        name: Unique name.
        parts: Parts in the order of the observation.
        pairs: What has to be assembled, in order.
        high_layouts: For each hand-picked layout of ``high`` randomness, a pose a part.
        max_steps: Steps after which an episode times out (1000 a pair in the paper).
        num_critical_states: Critical states a demonstration (paper Table IV).
        gripper_width_m: Opening of the gripper.
        milestones: Names of the steps on the way to success, in order.
    """

    name: str
    parts: tuple[PartSpec, ...]
    pairs: tuple[AssemblyPair, ...]
    high_layouts: tuple[Mapping[str, Pose], ...]
    max_steps: int
    num_critical_states: int
    gripper_width_m: float
    milestones: tuple[str, ...]
