"""Between what an operator intends and what its device reports: the hand."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from juicer.demonstration.operator import OperatorStep
from juicer.expert.pose import Pose, Vector, turned
from juicer.expert.sight import Sight
from juicer.expert.skills import Command

TremorM = Annotated[float, Field(ge=0, le=0.01, description="standard deviation of the tremor along each axis")]
TremorRad = Annotated[float, Field(ge=0, le=0.1, description="the same about each axis")]
TremorMemory = Annotated[float, Field(ge=0, lt=1, description="correlation of the tremor from one step to the next")]

Decide = Callable[[Sight], Command]
"""The next command of whatever the operator is busy with, from what it sees."""


@dataclass(frozen=True, kw_only=True)
class ScriptedStep(OperatorStep):
    """A control step of the scripted operator.

    Attributes:
        phase: What the operator is busy with.
    """

    phase: str


class Hand(Protocol):
    """Carries out what the operator decides, for the length of one recording."""

    def act(self, sight: Sight, decide: Decide) -> ScriptedStep:
        """What the device reports for the next control step.

        Args:
            sight: What there is to be seen now.
            decide: Asked for a command unless the operator pauses.
        """
        ...


class Tremor:
    """Shaking of the end effector about its target: noise that remembers itself from one step to the next."""

    def __init__(self, rng: np.random.Generator, size_m: float, size_rad: float, memory: float) -> None:
        """Begin without any.

        Args:
            rng: Source of the noise.
            size_m: Its standard deviation along each axis.
            size_rad: The same about each axis.
            memory: Correlation from one step to the next.
        """
        self._rng = rng
        self._size_m, self._size_rad, self._memory = size_m, size_rad, memory
        self._noise = np.zeros(6)

    def shaken(self, target: Pose) -> Pose:
        """The target of the next step, shaken."""
        self._noise = self._memory * self._noise + math.sqrt(1 - self._memory**2) * self._rng.standard_normal(6)
        position: Vector = target.position + self._size_m * self._noise[:3]
        return Pose(position, turned(self._size_rad * self._noise[3:], target.rotation))


def action_of(target: Pose, gripper: float) -> NDArray[np.float32]:
    """Action ``(10,)`` that sends the end effector to a pose."""
    action = np.concatenate([target.position, target.rotation[0], target.rotation[1], [gripper]])
    rounded: NDArray[np.float32] = np.clip(action, -1.0, 1.0).astype(np.float32)
    return rounded
