"""An operator's own ways, drawn anew for each demonstration."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from juicer.expert.skills import Pace

_MOST_PARTS = 8
_FUMBLING = 0.12
"""Chance that a part is grasped too early. Policies miss a grasp now and then, and learn only here to open again."""


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
        grasp_yaw_rad: How far the end effector is turned from its usual grasp of a part that stands, to the next turn
            at which the part looks the same.
        reaction_steps: How many steps ago that was seen which the operator acts on.
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
    grasp_yaw_rad: float = 0.0
    reaction_steps: int = 0

    @classmethod
    def draw(cls, rng: np.random.Generator, variety: float = 1.0) -> Habits:
        """Habits for one demonstration.

        Args:
            rng: Source of the habits.
            variety: How much wider than usual the choice is where a task leaves one.
        """

        def choice(low: float, high: float) -> float:
            wider = 0.5 * (variety - 1) * (high - low)
            return rng.uniform(low - wider, high + wider)

        return cls(
            pace=Pace(lead_m=rng.uniform(0.016, 0.022), lead_rad=rng.uniform(0.22, 0.32)),
            clearance_m=choice(0.055, 0.075),
            rim_height_m=rng.uniform(0.020, 0.024),
            rim_offset_m=choice(-0.010, 0.010),
            # Less, and over the hole the wrist comes to its limit, where it no longer follows its target.
            tilt_rad=math.radians(rng.uniform(50, 53)),
            pick_offset_m=choice(-0.0025, 0.0025),
            pick_height_m=rng.uniform(0.003, 0.006),
            lift_m=choice(0.055, 0.070),
            via=(choice(0.50, 0.55), choice(0.10, 0.14), choice(0.145, 0.165)),
            screw_offset_m=rng.uniform(-0.002, 0.002),
            fumbles=frozenset(np.flatnonzero(rng.random(_MOST_PARTS) < _FUMBLING).tolist()),
            fumble_m=rng.uniform(0.0, 0.03),
        )

    def turn(self, symmetry_rad: float) -> float:
        """How far the grasp of a part is turned from the usual one, whose fingers fit at every ``symmetry_rad``."""
        return symmetry_rad * round(self.grasp_yaw_rad / symmetry_rad)
