"""What a critical state is, in words for whoever marks it."""

from __future__ import annotations

from dataclasses import dataclass

from juicer.tasks.specification import AssemblyTask, Insertion


@dataclass(frozen=True)
class Explanation:
    """A critical state in words.

    Attributes:
        definition: Which step it is.
        right: What is seen at that step.
        wrong: What is seen at a later one.
    """

    definition: str
    right: str
    wrong: str


def explain(task: AssemblyTask, index: int) -> Explanation:
    """Explain a critical state of a task, by its index."""
    state = task.critical_states[index]
    part = task.name_of(state).partition(" ")[2]
    if isinstance(state, Insertion):
        return Explanation(
            f"The last step at which the {part} is held and still clear of what it goes into, just before it comes "
            "within touching distance. What follows, contact and all, is carried out as it was demonstrated.",
            f"the {part} is held, and still clear of what it goes into",
            f"too late, the {part} is within touching distance, or let go",
        )
    return Explanation(
        f"The last step at which the open gripper is still a little away from where it closes on the {part}. What "
        "follows, contact and all, is carried out as it was demonstrated.",
        f"the gripper is open, and still a little away from the {part}",
        f"too late, the gripper is where it closes on the {part}, or has closed",
    )
