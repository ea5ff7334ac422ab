"""A scripted operator that stands in for a human, so that everything runs from nothing.

It sees what a human sees: the observation. It is not a policy and is never evaluated as one. What it decides to do is
in :mod:`juicer.expert.assembly`; what its hand makes of that is its temperament.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from juicer.demonstration.operator import OperatorFactory
from juicer.expert.assembly import AssemblyOperator
from juicer.expert.hand import ScriptedStep
from juicer.expert.sight import Sight
from juicer.expert.skills import Command, Skill
from juicer.expert.steady import Steady
from juicer.expert.temperament import Temperament
from juicer.seeding import stream
from juicer.tasks.specification import AssemblyTask

DEVICE = "scripted operator"


def scripted_operators(root_seed: int = 0, temperament: Temperament | None = None) -> OperatorFactory:
    """One operator a recording, whose ways depend on its seed, ``root_seed`` and its temperament alone."""
    return lambda task, seed: ScriptedOperator(task, stream(root_seed, "operator", seed), temperament)


class ScriptedOperator:
    """Assembles one piece of furniture, seeing only observations; one instance for one demonstration."""

    device = DEVICE

    def __init__(self, task: AssemblyTask, rng: np.random.Generator, temperament: Temperament | None = None) -> None:
        """Draw the habits of this demonstration.

        Args:
            task: What to assemble.
            rng: Source of everything that varies.
            temperament: How unlike a machine the operator is; steady if None.

        Raises:
            ConfigError: If the operator has not learned the task.
        """
        temperament = temperament or Steady()
        self._task = task
        habits = temperament.habits(rng)
        self._operator = AssemblyOperator(task, habits)
        self._hand = temperament.hand(rng, habits)
        self._work: Skill | None = None

    def act(self, observation: Mapping[str, NDArray[np.floating[Any]]]) -> ScriptedStep:
        """Decide on the next control step.

        Args:
            observation: What the environment shows now.
        """
        return self._hand.act(Sight(self._task, observation), self._decide)

    def _decide(self, sight: Sight) -> Command:
        if self._work is None:
            self._work = self._operator.work(sight)
            return next(self._work)
        return self._work.send(sight)
