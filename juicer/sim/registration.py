"""Gymnasium ids of the assembly tasks, e.g. ``juicer/OneLeg-v0``."""

from __future__ import annotations

import gymnasium

from juicer.tasks.registry import TASK_NAMES


def environment_id(task: str) -> str:
    """Gymnasium id of a task: ``one_leg`` is ``juicer/OneLeg-v0``."""
    return f"juicer/{''.join(word.capitalize() for word in task.split('_'))}-v0"


def register_environments() -> None:
    """Make ``gymnasium.make("juicer/OneLeg-v0")`` work. Called by Gymnasium itself through the entry point."""
    for task in TASK_NAMES:
        if environment_id(task) not in gymnasium.registry:
            gymnasium.register(
                id=environment_id(task),
                entry_point="juicer.sim.env:AssemblyEnv",
                vector_entry_point="juicer.sim.vector:AssemblyVectorEnv",
                kwargs={"task": task},
            )
