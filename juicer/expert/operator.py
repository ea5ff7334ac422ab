"""A scripted operator with a human's habits: own pace and paths, tremor, hesitation.

It stands in for a human so that everything runs from nothing, and sees what a human sees: the observation. It is
no policy and is never evaluated as one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from juicer.demonstration.operator import OperatorFactory, OperatorStep
from juicer.expert.assembly import AssemblyOperator
from juicer.expert.handling import Habits
from juicer.expert.pose import turned
from juicer.expert.sight import Sight
from juicer.expert.skills import OPEN, Command, Skill
from juicer.seeding import stream
from juicer.tasks.specification import AssemblyTask

DEVICE = "scripted operator"

_THOUGHTLESS = ("grasp", "release", "insert", "stroke", "let go")
"""Beginnings of phases in which nobody stops to think."""

_BUSY_WITH_GRIPPER = 13
"""Steps after a toggle of the gripper in which the operator does not pause: recordings keep them."""


@dataclass(frozen=True)
class Temperament:
    """How unlike a machine the operator is.

    Attributes:
        tremor_m: Standard deviation of the end effector's tremor along each axis.
        tremor_rad: The same about each axis.
        tremor_memory: Correlation of the tremor from one step to the next.
        tempo_spread: Relative spread of the pace from phase to phase.
        hesitation: Chance of a pause when another phase begins.
        longest_pause: Its greatest length in steps.
    """

    tremor_m: float = 1.0e-3
    tremor_rad: float = math.radians(0.6)
    tremor_memory: float = 0.8
    tempo_spread: float = 0.08
    hesitation: float = 0.3
    longest_pause: int = 12


@dataclass(frozen=True, kw_only=True)
class ScriptedStep(OperatorStep):
    """A control step of this operator.

    Attributes:
        phase: What the operator is busy with.
    """

    phase: str


def scripted_operators(root_seed: int = 0) -> OperatorFactory:
    """One operator a recording, whose habits depend on its seed and ``root_seed`` alone."""
    return lambda task, seed: ScriptedOperator(task, stream(root_seed, "operator", seed))


class ScriptedOperator:
    """Assembles one piece of furniture, seeing only observations; one instance for one demonstration."""

    device = DEVICE

    def __init__(self, task: AssemblyTask, rng: np.random.Generator, temperament: Temperament | None = None) -> None:
        """Draw the habits of this demonstration.

        Args:
            task: What to assemble.
            rng: Source of everything that varies.
            temperament: How unlike a machine the operator is.

        Raises:
            ConfigError: If the operator has not learned the task.
        """
        self._task = task
        self._rng = rng
        self._temperament = temperament or Temperament()
        self._operator = AssemblyOperator(task, Habits.draw(rng))
        self._work: Skill | None = None
        self._tremor = np.zeros(6)
        self._tempo = 1.0
        self._pause = 0
        self._thinks = False
        self._gripper = OPEN
        self._steps_since_toggle = 0
        self._last: ScriptedStep | None = None

    def act(self, observation: Mapping[str, NDArray[np.floating[Any]]]) -> ScriptedStep:
        """Decide on the next control step.

        Args:
            observation: What the environment shows now.
        """
        if self._pause and self._last is not None:
            self._pause -= 1
            self._last = ScriptedStep(self._last.action, idle=True, phase=self._last.phase)
            return self._last
        sight = Sight(self._task, observation)
        if self._work is None:
            self._work = self._operator.work(sight)
            command = next(self._work)
        else:
            command = self._work.send(sight)
        self._notice(command)
        self._last = ScriptedStep(self._action(sight, command), idle=False, phase=command.phase)
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

    def _action(self, sight: Sight, command: Command) -> NDArray[np.float32]:
        """The command at the present tempo, shaken by the tremor."""
        memory = self._temperament.tremor_memory
        self._tremor = memory * self._tremor + math.sqrt(1 - memory**2) * self._rng.standard_normal(6)
        position = sight.end_effector.position + self._tempo * (command.target.position - sight.end_effector.position)
        position = position + self._temperament.tremor_m * self._tremor[:3]
        rotation = turned(self._temperament.tremor_rad * self._tremor[3:], command.target.rotation)
        action = np.concatenate([position, rotation[0], rotation[1], [command.gripper]])
        rounded: NDArray[np.float32] = np.clip(action, -1.0, 1.0).astype(np.float32)
        return rounded
