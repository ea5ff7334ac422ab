"""The steady operator: does at once what it decides, shakes a little, and leaves the device alone now and then."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from pydantic import Field

from juicer.config import StrictConfig
from juicer.expert.habits import Habits
from juicer.expert.hand import Decide, Hand, ScriptedStep, Tremor, TremorM, TremorMemory, TremorRad, action_of
from juicer.expert.pose import Pose
from juicer.expert.sight import Sight
from juicer.expert.skills import OPEN, Command

_THOUGHTLESS = ("grasp", "release", "insert", "stroke", "let go")
"""Beginnings of phases in which nobody stops to think."""

_BUSY_WITH_GRIPPER = 13
"""Steps after a toggle of the gripper in which the operator does not pause: recordings keep them."""


class Steady(StrictConfig):
    """An operator whose pauses are all idle, so that ingestion drops them."""

    kind: Literal["steady"] = "steady"
    tremor_m: TremorM = 1.0e-3
    tremor_rad: TremorRad = math.radians(0.6)
    tremor_memory: TremorMemory = 0.8
    tempo_spread: float = Field(
        default=0.08, ge=0, le=0.5, description="relative spread of the pace from phase to phase"
    )
    hesitation: float = Field(default=0.3, ge=0, le=1, description="chance of a pause when another phase begins")
    longest_pause: int = Field(default=12, ge=2, le=1000, description="its greatest length in steps")

    def habits(self, rng: np.random.Generator) -> Habits:
        """Ways of one demonstration."""
        return Habits.draw(rng)

    def hand(self, rng: np.random.Generator, habits: Habits) -> Hand:
        """What carries out the operator's decisions in one demonstration."""
        return SteadyHand(rng, self)


class SteadyHand:
    """The hand of the steady operator."""

    def __init__(self, rng: np.random.Generator, temperament: Steady) -> None:
        """Begin with an open gripper."""
        self._rng = rng
        self._temperament = temperament
        self._tremor = Tremor(rng, temperament.tremor_m, temperament.tremor_rad, temperament.tremor_memory)
        self._tempo = 1.0
        self._pause = 0
        self._thinks = False
        self._gripper = OPEN
        self._steps_since_toggle = 0
        self._last: ScriptedStep | None = None

    def act(self, sight: Sight, decide: Decide) -> ScriptedStep:
        """What the device reports for the next control step."""
        if self._pause and self._last is not None:
            self._pause -= 1
            self._last = ScriptedStep(self._last.action, idle=True, phase=self._last.phase)
            return self._last
        command = decide(sight)
        self._notice(command)
        here, target = sight.end_effector.position, command.target
        paced = Pose(here + self._tempo * (target.position - here), target.rotation)
        action = action_of(self._tremor.shaken(paced), command.gripper)
        self._last = ScriptedStep(action, idle=False, phase=command.phase)
        return self._last

    def _notice(self, command: Command) -> None:
        """Change the tempo when another phase begins, and pause where there is time to think."""
        self._steps_since_toggle = 0 if command.gripper != self._gripper else self._steps_since_toggle + 1
        self._gripper = command.gripper
        if self._last is None or command.phase != self._last.phase:
            spread = self._temperament.tempo_spread
            self._tempo = float(np.clip(1 + spread * self._rng.standard_normal(), 1 - 2 * spread, 1 + 2 * spread))
            self._thinks = self._rng.random() < self._temperament.hesitation
        thoughtless = command.phase.startswith(_THOUGHTLESS)
        if self._thinks and not thoughtless and self._steps_since_toggle >= _BUSY_WITH_GRIPPER:
            self._pause = int(self._rng.integers(2, self._temperament.longest_pause + 1))
            self._thinks = False
