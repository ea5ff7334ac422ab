"""Settings of trajectory augmentation."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from juicer.config import StrictConfig


def _ordered(bounds: tuple[float, float]) -> tuple[float, float]:
    if bounds[0] > bounds[1]:
        raise ValueError("the lower bound must not exceed the upper bound")
    return bounds


Bound = Annotated[float, Field(ge=0, le=360)]
Range = Annotated[tuple[Bound, Bound], AfterValidator(_ordered)]
"""Lower and upper bound of a uniform draw."""


class DepartureConfig(StrictConfig):
    """How the end effector leaves a critical state: up, off into a cone, turned on the spot, partly down again."""

    weight: float = Field(default=1.0, gt=0, le=1e6, description="how often it is drawn, relative to the other kinds")
    lift_m: Range = Field(description="straight up, before anything else")
    distance_m: Range = Field(description="length of the move into the cone")
    polar_deg: Range = Field(description="angle of that move from the vertical; 90 is sideways")
    rotation_deg: float = Field(ge=0, le=180, description="bound of roll, pitch and yaw about the gripper's axes")
    yaw_deg: float | None = Field(
        default=None, ge=0, le=180, description="bound of yaw, where it is not that of roll and pitch"
    )
    descent_m: Range = Field(
        default=(0.0, 0.0), description="straight down, after everything else; what is held may come to press"
    )
    step_m: Range = Field(description="travel an action, drawn once a snippet")
    step_deg: Range = Field(description="turn an action, drawn once a snippet")


NEAR = DepartureConfig(
    lift_m=(0.002, 0.03),
    distance_m=(0.001, 0.02),
    polar_deg=(60.0, 90.0),
    rotation_deg=4.0,
    step_m=(0.002, 0.006),
    step_deg=(2.0, 4.0),
)
"""Millimetres beside and above the goal: what a policy meets when it aims a little wrong."""

BESIDE = DepartureConfig(
    weight=2.0,
    lift_m=(0.002, 0.008),
    distance_m=(0.002, 0.03),
    polar_deg=(85.0, 90.0),
    rotation_deg=3.0,
    descent_m=(0.008, 0.022),
    step_m=(0.002, 0.004),
    step_deg=(2.0, 4.0),
)
"""Down beside the goal, often touching there: what a policy meets when it has missed. The way back goes up first.

Rollouts that fail come down up to three centimetres aside, and drift farther for want of an example.
"""

FAR = DepartureConfig(
    lift_m=(0.0, 0.02),
    distance_m=(0.02, 0.16),
    polar_deg=(5.0, 75.0),
    rotation_deg=15.0,
    step_m=(0.008, 0.014),
    step_deg=(4.3, 7.5),
)
"""The paper's cone, shrunk to where rollouts go astray; the speeds are a demonstrator's."""

TURNED = DepartureConfig(
    weight=2.0,
    lift_m=(0.02, 0.06),
    distance_m=(0.001, 0.03),
    polar_deg=(60.0, 90.0),
    rotation_deg=4.0,
    yaw_deg=45.0,
    step_m=(0.004, 0.01),
    step_deg=(4.3, 7.5),
)
"""Over the goal, turned about the gripper's axis: what a policy meets that has not turned far enough on its way."""


class GraspConfig(StrictConfig):
    """How differently a part is held than in the demonstration."""

    shift_m: float = Field(default=0.006, ge=0, le=0.1, description="bound of shifts across and along the fingers")
    pitch_deg: float = Field(default=6.0, ge=0, le=90, description="bound of turns about the axis between the fingers")


class ToleranceConfig(StrictConfig):
    """How close a snippet must come to the demonstration; the defaults are the paper's."""

    position_m: float = Field(default=0.017, gt=0, le=10, description="largest distance of a part from where it was")
    rotation_deg: float = Field(default=20.0, gt=0, le=360, description="largest turn of a part from how it was")
    gripper_width_m: float = Field(
        default=0.005, gt=0, le=10, description="largest difference of the gripper's opening"
    )


class UniformPlacement(StrictConfig):
    """Departures as they are drawn."""

    kind: Literal["uniform"] = "uniform"


class CoveragePlacement(StrictConfig):
    """Of several departures the one that leads where nothing has been yet, rather close to where rollouts failed."""

    kind: Literal["coverage"] = "coverage"
    candidates: int = Field(default=16, gt=0, le=10_000, description="departures drawn, of which one is made")
    position_m: float = Field(default=0.005, gt=0, le=10, description="distance of two offsets that counts as 1")
    rotation_deg: float = Field(default=4.0, gt=0, le=360, description="turn between two offsets that counts as 1")


Placement = Annotated[UniformPlacement | CoveragePlacement, Field(discriminator="kind")]
"""How the departures of snippets are chosen."""


class AugmentationConfig(StrictConfig):
    """Which corrective episodes to make, and when to believe one."""

    num_snippets: int = Field(default=288, gt=0, le=1_000_000, description="corrective episodes wanted")
    max_attempts_per_snippet: int = Field(
        default=4, gt=0, le=1000, description="attempts after which to settle for less"
    )
    departures: dict[Annotated[str, Field(min_length=1, max_length=100)], DepartureConfig] = Field(
        default={"near": NEAR, "beside": BESIDE, "turned": TURNED, "far": FAR}, min_length=1, max_length=64
    )
    placement: Placement = UniformPlacement()
    grasp: GraspConfig | None = Field(
        default=None, description="other grasps of what is held at a critical state; none: the demonstration's own"
    )
    steps_after_gripper_change: int = Field(
        default=5, gt=0, le=10_000, description="where a snippet ends, after the next gripper change (paper 30)"
    )
    # A departure that pushes the lamp's loose base aside leads back millimetres beside it, and would teach to miss.
    tolerance: ToleranceConfig = Field(
        default=ToleranceConfig(position_m=0.002), description="at the next gripper change, before anything is let go"
    )
    end_tolerance: ToleranceConfig = Field(default=ToleranceConfig(), description="at the end of the snippet")
    min_confidence: float = Field(default=0.5, ge=0, le=1, description="proposals below it are not used")
