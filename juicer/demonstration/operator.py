"""Operators: whoever or whatever holds the device that says what the robot shall do next."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from juicer.tasks.specification import AssemblyTask


@dataclass(frozen=True)
class OperatorStep:
    """What an operator's device reports for one control step.

    Attributes:
        action: Absolute action ``(10,)``, see :data:`juicer.episode.ACTION_SIZE`.
        idle: Whether the operator left the device alone; the action then repeats the last one.
    """

    action: NDArray[np.generic]
    idle: bool = False


class Operator(Protocol):
    """Whoever assembles, for the length of one recording."""

    @property
    def device(self) -> str:
        """What the operator holds, as it shall stand in the log."""
        ...

    def act(self, observation: Mapping[str, NDArray[np.floating[Any]]]) -> OperatorStep:
        """Decide on the next control step, seeing what the environment shows now."""
        ...


OperatorFactory = Callable[[AssemblyTask, int], Operator]
"""Makes the operator of one recording, from the assembly task and the initial-state seed."""
