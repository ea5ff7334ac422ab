"""How an operator builds a piece of furniture: the first part into the corner, then one part after the other."""

from __future__ import annotations

import math

from juicer.errors import ConfigError
from juicer.expert.clearing import Clearing
from juicer.expert.corner import Corner
from juicer.expert.habits import Habits
from juicer.expert.mounting import Mounting, ScrewMounting
from juicer.expert.pair_view import PairView
from juicer.expert.sight import Sight
from juicer.expert.skills import OPEN, Skill, rise
from juicer.tasks.handling import Handling
from juicer.tasks.specification import AssemblyTask, Joint

_BETWEEN_PARTS_M = 0.13
"""Height of the end effector between two parts, above what lies on the table."""


_MOUNTINGS = {Joint.SCREWED: ScrewMounting, Joint.PUT_ON: Mounting}


class AssemblyOperator:
    """Works on one task, whatever state it is in."""

    def __init__(self, task: AssemblyTask, habits: Habits) -> None:
        """Prepare to work on ``task``.

        Raises:
            ConfigError: If the operator does not know how to handle one of its parts.
        """
        self._habits = habits
        self._corner = Corner(task, habits)
        self._clearing = Clearing(task, self._corner, habits)
        self._mountings = [
            _MOUNTINGS[pair.joint](task, PairView(task, index, _handling(task, pair.second)), habits)
            for index, pair in enumerate(task.pairs)
        ]

    def work(self, sight: Sight) -> Skill:
        """Work for ever; whoever listens stops when the task is done."""
        busy_with = self._mountings[0]
        while True:
            mounting = next((each for each in self._mountings if self._is_to_be_done(each, sight)), self._mountings[-1])
            if mounting is not busy_with:
                height = max(_BETWEEN_PARTS_M, busy_with.view.clear_of_part(sight))
                sight = yield from rise(sight, height, OPEN, self._habits.pace, "rise")
                busy_with = mounting
            begun = any(each.is_begun(sight) for each in self._mountings)
            if begun or self._corner.is_home(sight, 0.008, math.radians(6)):
                sight = yield from mounting.step(sight)
            elif (in_the_way := self._clearing.next_part(sight)) is not None:
                sight = yield from self._clearing.lay_aside(sight, in_the_way)
            else:
                sight = yield from self._corner.push_home(sight)

    def _is_to_be_done(self, mounting: Mounting, sight: Sight) -> bool:
        """Whether a part is not mounted yet; one that has come loose under another is screwed home along with that."""
        covered = any(
            other.view.mate_index == mounting.view.part_index and other.is_begun(sight) for other in self._mountings
        )
        return not covered and not mounting.view.is_seated(sight)


def _handling(task: AssemblyTask, index: int) -> Handling:
    part = task.parts[index]
    if not isinstance(part.handling, Handling):
        raise ConfigError(f"the scripted operator has not learned '{task.name}': it cannot mount '{part.name}'")
    return part.handling
