"""Tasks by name."""

from __future__ import annotations

from juicer.errors import ConfigError, did_you_mean
from juicer.tasks.discovery import find_tasks
from juicer.tasks.specification import AssemblyTask
from juicer.text import printable

_TASKS = find_tasks()
TASK_NAMES = tuple(_TASKS)


def get_task(name: str) -> AssemblyTask:
    """Specification of the task called ``name``.

    Raises:
        ConfigError: If there is no such task, or what announces it from outside is broken.
    """
    try:
        load = _TASKS[name]
    except (KeyError, TypeError):  # what is no text may not even be looked up
        raise ConfigError(f"unknown task '{printable(name)}'{did_you_mean(str(name), _TASKS)}") from None
    return load()
