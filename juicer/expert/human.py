"""The human-like operator: reacts late, overshoots and corrects, hurries and dawdles, waits where a person would look.

A person's hand holds a device whose deflection is added to where the end effector is *now*, while eye and mind are
some tenths of a second behind. Overshoot and correction follow from that delay; they are not drawn.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace
from typing import Literal

import numpy as np
from pydantic import Field

from juicer.config import StrictConfig
from juicer.expert.habits import Habits
from juicer.expert.hand import Decide, Hand, ScriptedStep, Tremor, TremorM, TremorMemory, TremorRad, action_of
from juicer.expert.pose import UP, Pose, length, turn_between, turned
from juicer.expert.sight import Sight
from juicer.expert.skills import OPEN, Command

_IN_THE_OPEN = ("go to", "bring", "stand", "rise", "take")
"""Beginnings of phases whose way through the air is anybody's choice."""

_STRAIGHT_M = 0.015
"""Lead of the target below which the way to a goal is no longer bent."""

_SLOWEST, _FASTEST = 0.4, 1.2
"""Bounds of the tempo: no phase shall take for ever, nor the arm be asked for more than the steady operator asks."""


class Human(StrictConfig):
    """An operator with a person's delays, pauses and ways. Its pauses are recorded unless it lets go of the device."""

    kind: Literal["human"] = "human"
    tremor_m: TremorM = 0.5e-3
    tremor_rad: TremorRad = math.radians(0.4)
    tremor_memory: TremorMemory = 0.8
    reaction_steps: int = Field(
        default=2, ge=0, le=5, description="greatest delay of what is seen; each demonstration has its own, from 1 on"
    )
    care: float = Field(
        default=1.2,
        ge=0,
        le=3,
        description="by how much the target leads less near a goal for each step of that delay, as who reacts late "
        "must approach with care",
    )
    tempo: float = Field(default=0.9, ge=0.4, le=1.2, description="mean pace, as a share of the steady operator's")
    tempo_spread: float = Field(
        default=0.15, ge=0, le=0.5, description="relative spread of the pace from phase to phase"
    )
    tempo_drift: float = Field(default=0.2, ge=0, le=0.5, description="relative spread of the pace within a phase")
    tempo_memory: float = Field(
        default=0.9, ge=0, lt=1, description="correlation of that drift from one step to the next"
    )
    hesitation: float = Field(default=0.6, ge=0, le=1, description="chance of a pause when another phase begins")
    pause: float = Field(default=6.0, ge=1, le=100, description="median length of a pause in steps")
    pause_spread: float = Field(
        default=0.6, ge=0, le=1.5, description="standard deviation of the logarithm of that length"
    )
    longest_pause: int = Field(default=40, ge=1, le=1000, description="greatest length of a pause in steps")
    letting_go: float = Field(
        default=0.2,
        ge=0,
        le=1,
        description="share of the pauses in which the hand leaves the device: idle steps, which ingestion drops",
    )
    bend_rad: float = Field(
        default=math.radians(25), ge=0, le=math.radians(60), description="greatest bend of a way through the air"
    )
    variety: float = Field(
        default=2.0, ge=1, le=3, description="how much wider than the steady operator's the choice of ways is"
    )
    grasp_yaw_rad: float = Field(
        default=math.radians(35),
        ge=0,
        le=math.radians(45),
        description="greatest turn of the gripper from the usual grasp, where a part's symmetry allows it",
    )

    def habits(self, rng: np.random.Generator) -> Habits:
        """Ways of one demonstration."""
        habits = Habits.draw(rng, self.variety)
        reaction = int(rng.integers(min(1, self.reaction_steps), self.reaction_steps + 1))
        return replace(
            habits,
            pace=replace(habits.pace, gain=habits.pace.gain / (1 + self.care * reaction)),
            reaction_steps=reaction,
            grasp_yaw_rad=rng.uniform(-self.grasp_yaw_rad, self.grasp_yaw_rad),
        )

    def hand(self, rng: np.random.Generator, habits: Habits) -> Hand:
        """What carries out the operator's decisions in one demonstration."""
        return HumanHand(rng, self, habits.reaction_steps)


class HumanHand:
    """The hand of the human-like operator."""

    def __init__(self, rng: np.random.Generator, temperament: Human, reaction_steps: int) -> None:
        """Begin with an open gripper."""
        self._rng = rng
        self._temperament = temperament
        self._tremor = Tremor(rng, temperament.tremor_m, temperament.tremor_rad, temperament.tremor_memory)
        self._reaction = reaction_steps
        self._seen: deque[Sight] = deque(maxlen=reaction_steps + 1)
        self._intended: tuple[Command, Pose] | None = None
        self._phase = ""
        self._phase_tempo, self._drift, self._bend_rad = 1.0, 0.0, 0.0
        self._gripper = OPEN
        self._pause, self._lets_go = 0, False
        self._held: Pose | None = None
        self._last: ScriptedStep | None = None

    def act(self, sight: Sight, decide: Decide) -> ScriptedStep:
        """What the device reports for the next control step."""
        self._seen.append(sight)
        memory = self._temperament.tempo_memory
        self._drift = memory * self._drift + math.sqrt(1 - memory**2) * self._rng.standard_normal()
        if not self._pause and self._intended is None:
            seen = self._seen[0]
            self._intended = decide(seen), seen.end_effector
            self._begin(self._intended[0].phase)
        if self._pause or self._intended is None:
            self._last = self._resting(sight)
        else:
            self._last = self._moving(sight, *self._intended)
            self._intended = None
        return self._last

    def _begin(self, phase: str) -> None:
        """In another phase the pace and the way are others, and there may be a pause before it."""
        if phase == self._phase:
            return
        self._phase = phase
        own, rng = self._temperament, self._rng
        self._phase_tempo = 1 + own.tempo_spread * rng.standard_normal()
        self._bend_rad = own.bend_rad * rng.uniform(-1, 1) if phase.startswith(_IN_THE_OPEN) else 0.0
        if rng.random() < own.hesitation:
            steps = own.pause * math.exp(own.pause_spread * rng.standard_normal())
            self._pause_for(min(max(1, round(steps)), own.longest_pause), lets_go=rng.random() < own.letting_go)

    def _pause_for(self, steps: int, *, lets_go: bool = False) -> None:
        self._pause, self._lets_go, self._held = steps, lets_go, None

    def _resting(self, sight: Sight) -> ScriptedStep:
        """Stay where the end effector was when the pause began: with a trembling hand, or with none."""
        self._pause -= 1
        if self._lets_go and self._last is not None:
            return ScriptedStep(self._last.action, idle=True, phase=self._phase)
        self._held = self._held or sight.end_effector
        return ScriptedStep(action_of(self._tremor.shaken(self._held), self._gripper), phase=self._phase)

    def _moving(self, sight: Sight, command: Command, seen: Pose) -> ScriptedStep:
        """Deflect the device as was decided on what was seen, from where the end effector is by now."""
        own, here = self._temperament, sight.end_effector
        tempo = own.tempo * (self._phase_tempo + own.tempo_drift * self._drift)
        tempo = min(max(tempo, _SLOWEST), _FASTEST)
        lead = tempo * (command.target.position - seen.position)
        bend = self._bend_rad * min(1.0, length(lead) / _STRAIGHT_M)
        turn = tempo * turn_between(seen.rotation, command.target.rotation)
        target = Pose(here.position + turned(bend * UP, np.eye(3)) @ lead, turned(turn, here.rotation))
        if command.gripper != self._gripper:
            # Until the fingers are seen to move there is nothing to decide on.
            self._pause_for(self._reaction)
        self._gripper = command.gripper
        return ScriptedStep(action_of(self._tremor.shaken(target), command.gripper), phase=command.phase)
