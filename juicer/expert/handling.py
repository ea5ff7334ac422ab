"""How an operator handles the parts: where each is grasped, and the operator's own ways."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from juicer.expert.skills import Pace


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


_MOST_PARTS = 8
_FUMBLING = 0.12
"""Chance that a part is grasped too early. Policies miss a grasp now and then, and learn only here to open again."""

_SQUARE_LEG = Handling((0.015, 0.056, 0.015), 0.0115, 0.030, 0.012, 0.030)

HANDLINGS = {
    **{f"square_table_leg{number}": _SQUARE_LEG for number in (1, 2, 3, 4)},
    "round_table_leg": Handling(
        (0.0213, 0.052, 0.0213), 0.034, 0.0425, 0.032, 0.0425, flat_every_rad=math.pi / 6
    ),
    "round_table_base": Handling(
        (0.065, 0.029, 0.065), 0.004, 0.0468, 0.004, 0.0468,
        flat_rad=math.pi / 4, turn_back_above_m=0.04, lies=False, pick_play_m=0.0022,
    ),
    "lamp_hood": Handling(
        (0.044, 0.050, 0.044), -0.046, 0.0655, -0.046, 0.0655,
        flat_every_rad=math.pi / 8, lies=False, around_m=0.0065, aligned_m=0.0012, clear_m=0.105,
        pick_play_m=0.002,
    ),
    "lamp_bulb": Handling(
        (0.030, 0.060, 0.030), 0.038, 0.0595, 0.038, 0.0595,
        flat_every_rad=math.pi / 36, pick_below_m=0.008, pick_play_m=0.003, is_ball=True,
    ),
}  # fmt: skip
"""By name of the part."""


@dataclass(frozen=True)
class Habits:
    """What an operator does in an own way, all along a demonstration.

    Attributes:
        pace: How boldly the operator moves.
        clearance_m: Height at which the end effector travels above what it will grasp.
        rim_height_m: Height above the table at which a part is grasped to be pushed.
        rim_offset_m: Distance of that grasp from the middle of the rim.
        tilt_rad: Tilt of the end effector that picks up a lying part.
        pick_offset_m: Distance of that grasp from where the part is usually grasped, along its axis.
        pick_height_m: Height of that grasp above the part's axis.
        lift_m: Height of the end effector at which a lying part begins to be turned upright.
        via: Where the end effector stands it upright.
        screw_offset_m: Height of the grasp for a stroke over the usual one.
        fumbles: Parts, by index, for which the end effector closes too early once, on nothing.
        fumble_m: How far its fingers are above the part then.
    """

    pace: Pace
    clearance_m: float
    rim_height_m: float
    rim_offset_m: float
    tilt_rad: float
    pick_offset_m: float
    pick_height_m: float
    lift_m: float
    via: tuple[float, float, float]
    screw_offset_m: float
    fumbles: frozenset[int]
    fumble_m: float

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Habits:
        """Habits for one demonstration."""
        return cls(
            pace=Pace(lead_m=rng.uniform(0.016, 0.022), lead_rad=rng.uniform(0.22, 0.32)),
            clearance_m=rng.uniform(0.055, 0.075),
            rim_height_m=rng.uniform(0.020, 0.024),
            rim_offset_m=rng.uniform(-0.010, 0.010),
            # Less, and over the hole the wrist comes to its limit, where it no longer follows its target.
            tilt_rad=math.radians(rng.uniform(50, 53)),
            pick_offset_m=rng.uniform(-0.0025, 0.0025),
            pick_height_m=rng.uniform(0.003, 0.006),
            lift_m=rng.uniform(0.055, 0.070),
            via=(rng.uniform(0.50, 0.55), rng.uniform(0.10, 0.14), rng.uniform(0.145, 0.165)),
            screw_offset_m=rng.uniform(-0.002, 0.002),
            fumbles=frozenset(np.flatnonzero(rng.random(_MOST_PARTS) < _FUMBLING).tolist()),
            fumble_m=rng.uniform(0.0, 0.03),
        )
