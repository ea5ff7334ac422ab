"""Before the first part is pushed into the corner: what lies in its way there is laid elsewhere."""

from __future__ import annotations

from juicer.expert.corner import Corner
from juicer.expert.habits import Habits
from juicer.expert.laying import Laying
from juicer.expert.part_view import PartView
from juicer.expert.pose import Pose
from juicer.expert.sight import Sight
from juicer.expert.skills import Skill
from juicer.tasks.handling import Handling
from juicer.tasks.specification import AssemblyTask

_ATTEMPTS = 3


class Clearing:
    """The parts of a task beside the first, as far as they are in its way."""

    def __init__(self, task: AssemblyTask, corner: Corner, habits: Habits) -> None:
        """Prepare to work on ``task``."""
        self._corner = corner
        self._layings = {
            index: Laying(task, PartView(task, index, part.handling), habits)
            for index, part in enumerate(task.parts)
            if index and isinstance(part.handling, Handling)
        }
        self._attempts_left = dict.fromkeys(self._layings, _ATTEMPTS)

    def next_part(self, sight: Sight) -> int | None:
        """Which part to lay elsewhere, by its index; None if the first part can be pushed.

        What could not be taken away is pushed along.
        """
        for index, laying in self._layings.items():
            is_in_the_way = self._corner.is_in_the_way(sight, sight.part(index).position)
            if is_in_the_way and self._attempts_left[index] and laying.can_be_grasped(sight):
                return index
        return None

    def lay_aside(self, sight: Sight, index: int) -> Skill:
        """Lay a part where the first will not come, if there is such a place."""
        self._attempts_left[index] -= 1
        laying = self._layings[index]

        def keeps_clear(place: Pose) -> bool:
            return self._corner.keeps_clear(sight, place.position, laying.reach_m)

        place = laying.place(sight, keeps_clear)
        if place is None:
            self._attempts_left[index] = 0
            return sight
        return (yield from laying.lay(sight, place, "what is in the way"))
