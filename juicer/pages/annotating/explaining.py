"""What a critical state is, in words for whoever marks it."""

from __future__ import annotations

from juicer.tasks.specification import AssemblyTask, Insertion

_INSERTION = (
    "The last step at which the {part} is held and still clear of what it goes into, just before it comes within "
    "touching distance. What follows, contact and all, is carried out as it was demonstrated."
)
_GRASP = (
    "The last step at which the open gripper is still a little away from where it closes on the {part}. What follows, "
    "contact and all, is carried out as it was demonstrated."
)


def explain(task: AssemblyTask, index: int) -> str:
    """Definition of a critical state of a task, by its index."""
    state = task.critical_states[index]
    part = task.name_of(state).partition(" ")[2]
    return (_INSERTION if isinstance(state, Insertion) else _GRASP).format(part=part)
