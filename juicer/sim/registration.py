"""Gymnasium ids of the assembly tasks: ``gymnasium.make("juicer.sim.registration:juicer/OneLeg-v0")``.

What stands before the colon is imported by Gymnasium, and importing this module registers the ids.
"""

from __future__ import annotations

import gymnasium

from juicer.tasks.registry import TASK_NAMES


def environment_id(task: str) -> str:
    """Gymnasium id of a task: ``one_leg`` is ``juicer/OneLeg-v0``."""
    return f"juicer/{''.join(word.capitalize() for word in task.split('_'))}-v0"


for _task in TASK_NAMES:
    gymnasium.register(
        id=environment_id(_task),
        entry_point="juicer.sim.env:AssemblyEnv",
        vector_entry_point="juicer.sim.vector:AssemblyVectorEnv",
        kwargs={"task": _task},
    )
