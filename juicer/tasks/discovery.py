"""Which tasks there are: those in this folder, and those that other packages announce.

A module here that assigns ``TASK`` is a task. A package from outside announces its own by an entry point of the group
``juicer.tasks``: its name is the task's, its object an :class:`~juicer.tasks.specification.AssemblyTask`.
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable
from functools import cache, partial
from importlib.metadata import EntryPoint
from pathlib import Path

from juicer.announced import announced, load
from juicer.tasks.specification import AssemblyTask

GROUP = "juicer.tasks"
_DEFINES = re.compile(rb"^TASK = ", re.MULTILINE)
_PAPERS = ("one_leg", "round_table", "lamp", "square_table")
"""Those of the paper, in the order of its tables; all others are listed after them, by name."""


def find_tasks() -> dict[str, Callable[[], AssemblyTask]]:
    """What gives each task, by its name.

    Raises nothing for a task from outside that is broken: whoever asks for it is told so, and nobody else.
    """
    found: dict[str, Callable[[], AssemblyTask]] = {
        name: partial(_load, entry) for name, entry in announced(GROUP).items()
    }
    for path in Path(__file__).parent.glob("*.py"):
        # Read first: the modules that ask for the tasks lie in the same folder.
        if _DEFINES.search(path.read_bytes()):
            task: AssemblyTask = importlib.import_module(f"{__package__}.{path.stem}").TASK
            found[task.name] = partial(_itself, task)
    first = [name for name in _PAPERS if name in found]
    return {name: found[name] for name in [*first, *sorted(found.keys() - set(first))]}


def _itself(task: AssemblyTask) -> AssemblyTask:
    return task


@cache
def _load(entry: EntryPoint) -> AssemblyTask:
    """A task from outside.

    Raises:
        ConfigError: If there is none behind the entry point, or it contradicts itself.
    """
    from juicer.tasks.checks import check_task  # only whoever has such a task waits for pydantic to look at it

    task: AssemblyTask = load(entry, "task", partial(check_task, name=entry.name))
    return task
