"""Vocabulary in which an assembly task is written down. Data only: no physics, no policy.

Lengths are metres, masses kilograms, angles radians. A part frame is the one of FurnitureBench's part;
poses are ``(x, y, z, qw, qx, qy, qz)``. Positions on the table are in the robot base frame (x forward,
y to the robot's left, z up), in which the table's surface lies at :data:`TABLE_HEIGHT_M`.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

from juicer.errors import ConfigError, did_you_mean
from juicer.text import printable

if TYPE_CHECKING:
    # What only the operator reads is no part of what everybody else does.
    from juicer.tasks.handling import BaseHandling, Handling

Vector = tuple[float, float, float]
PoseValues = tuple[float, float, float, float, float, float, float]

TABLE_HEIGHT_M = -0.015

MOUNTED_M = 0.005
MOUNTED_COSINE = 0.94
"""FurnitureBench's test of a mounted part: each coordinate this close to its place, and the cosine of the angle
between each of its axes and where it belongs at least this."""


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
        raise ConfigError(f"unknown randomness '{printable(text)}'{did_you_mean(str(text), Randomness)}") from None


@dataclass(frozen=True)
class Box:
    """Solid box; ``yaw_rad`` turns it about the part's y axis."""

    center: Vector
    half_size: Vector
    yaw_rad: float = 0.0


@dataclass(frozen=True)
class Ball:
    """Solid sphere."""

    center: Vector
    radius: float


@dataclass(frozen=True)
class Shell:
    """Thin wall around the part's y axis, cylindrical or conical: a ring of flat panels.

    Attributes:
        bottom_y: Height of its lower edge.
        top_y: Height of its upper edge.
        bottom_radius: Inner radius at the lower edge (to the middle of a panel).
        top_radius: Inner radius at the upper edge.
        thickness: Of the wall.
        panels: Number of panels.
    """

    bottom_y: float
    top_y: float
    bottom_radius: float
    top_radius: float
    thickness: float
    panels: int


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
class Mark:
    """A patch painted on a part, so that it can be seen how the part is turned. It has no physics.

    Attributes:
        patch: A thin box, part of which stands out of the surface.
        rgb: Its colour, each channel in [0, 1].
    """

    patch: Box
    rgb: Vector


@dataclass(frozen=True)
class PartSpec:
    """One rigid part.

    Attributes:
        name: Unique name.
        mass: Kilograms.
        center_of_mass: In the part frame.
        inertia: Principal moments about the centre of mass, along the part's axes [kg m^2].
        boxes, balls, shells, pegs, bores, threads: Its geometry.
        start: Mean initial pose in the robot base frame.
        footprint: Extents (x, y) of the rectangle that keeps other parts away at reset.
        rgb: Colour, each channel in [0, 1].
        marks: Patches of other colours.
        is_round: Whether the footprint is a disc.
        start_shift_m: Range of its random shift along x and y at reset, if it has one of its own.
        rolls: Whether it is kept from rolling while the scene settles; afterwards it lies until it is touched.
        handling: How the scripted operator takes hold of it: to push it, if it is a task's first part, else to mount
            it; none if that operator has not learned it.
    """

    name: str
    mass: float
    center_of_mass: Vector
    inertia: Vector
    start: PoseValues
    footprint: tuple[float, float]
    rgb: Vector
    boxes: tuple[Box, ...] = ()
    balls: tuple[Ball, ...] = ()
    shells: tuple[Shell, ...] = ()
    pegs: tuple[Peg, ...] = ()
    bores: tuple[Bore, ...] = ()
    threads: tuple[Thread, ...] = ()
    marks: tuple[Mark, ...] = ()
    is_round: bool = False
    start_shift_m: tuple[float, float] | None = None
    rolls: bool = False
    handling: BaseHandling | Handling | None = None


class Joint(StrEnum):
    """How the second part of a pair is mounted, along its own y axis."""

    SCREWED = "screwed"
    PUT_ON = "put_on"


@dataclass(frozen=True)
class AssemblyPair:
    """Two parts that belong together.

    Attributes:
        label: What the second part is called in milestones.
        first: Index of the reference part.
        second: Index of the part mounted on it.
        targets: Poses of the second in the first's frame, any of which counts.
        operator_target: Index of the target that demonstrators aim at.
        joint: How it is mounted.
        any_rotation: Whether its rotation does not matter.
        after: Pairs, by index, that must be assembled before this one counts.
    """

    label: str
    first: int
    second: int
    targets: tuple[PoseValues, ...]
    operator_target: int = 0
    joint: Joint = Joint.SCREWED
    any_rotation: bool = False
    after: tuple[int, ...] = ()

    @property
    def milestones(self) -> tuple[str, ...]:
        """Names of the steps on the way, in order."""
        steps = {
            Joint.SCREWED: ("lifted", "upright", "over_hole", "inserted", "screwed"),
            Joint.PUT_ON: ("lifted", "over_seat", "put_on"),
        }[self.joint]
        return tuple(f"{self.label}_{step}" for step in steps)


@dataclass(frozen=True)
class Grasp:
    """Critical state: just before the gripper closes on a part, by index, to pick it up or to push it."""

    part: int


@dataclass(frozen=True)
class Insertion:
    """Critical state: just before the second part of a pair, by index, touches the first."""

    pair: int


CriticalState = Grasp | Insertion
"""A step where precision decides, as a kind of event."""


@dataclass(frozen=True)
class Placing:
    """Just before the gripper has pushed the task's first part home: where a policy lets go too early."""


FurtherState = Grasp | Placing
"""A step that is not a critical state of its task, but can be treated as one."""


@dataclass(frozen=True)
class AssemblyTask:
    """Everything that distinguishes one task from another.

    Attributes:
        name: Unique name.
        parts: Parts in the order of the observation.
        base_label: What the first part, which is pushed into the corner, is called in milestones.
        pairs: What has to be assembled, in order.
        high_layouts: For each hand-picked layout of ``high`` randomness, a pose a part, in their order.
        max_steps: Steps after which an episode times out (1000 a pair in the paper).
        critical_states: Those of a demonstration, in order (as many as in the paper's Table IV).
        gripper_width_m: Opening of the gripper.
    """

    name: str
    parts: tuple[PartSpec, ...]
    base_label: str
    pairs: tuple[AssemblyPair, ...]
    high_layouts: tuple[tuple[PoseValues, ...], ...]
    max_steps: int
    critical_states: tuple[CriticalState, ...]
    gripper_width_m: float

    @property
    def assembled_parts(self) -> tuple[int, ...]:
        """Indices of the parts that are to be assembled; others only lie about."""
        return tuple(sorted({part for pair in self.pairs for part in (pair.first, pair.second)}))

    @property
    def num_critical_states(self) -> int:
        """Critical states a demonstration."""
        return len(self.critical_states)

    @property
    def critical_state_names(self) -> tuple[str, ...]:
        """What happens at each critical state, e.g. ``grasp bulb`` or ``insert bulb``."""
        return tuple(map(self.name_of, self.critical_states))

    @property
    def further_states(self) -> tuple[FurtherState, ...]:
        """What may count as a critical state beside those of the task, which it follows: grasps, then the placing."""
        grasps = (Grasp(part) for part in (0, *(pair.second for pair in self.pairs)))
        return (*(grasp for grasp in grasps if grasp not in self.critical_states), Placing())

    def name_of(self, state: CriticalState | FurtherState) -> str:
        """What happens at a critical state, e.g. ``insert leg``."""
        if isinstance(state, Insertion):
            return f"insert {self.pairs[state.pair].label}"
        if isinstance(state, Placing):
            return f"place {self.base_label}"
        labels = {0: self.base_label} | {pair.second: pair.label for pair in self.pairs}
        return f"grasp {labels[state.part]}"

    @property
    def milestones(self) -> tuple[str, ...]:
        """Names of the steps on the way to success, in order."""
        return (f"{self.base_label}_placed", *(name for pair in self.pairs for name in pair.milestones))
