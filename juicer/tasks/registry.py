"""Tasks by name."""

from __future__ import annotations

from juicer.errors import ConfigError, did_you_mean
from juicer.tasks.lamp import LAMP
from juicer.tasks.one_leg import ONE_LEG
from juicer.tasks.round_table import ROUND_TABLE
from juicer.tasks.specification import AssemblyTask
from juicer.tasks.square_table import SQUARE_TABLE
from juicer.text import printable

_TASKS = {task.name: task for task in (ONE_LEG, ROUND_TABLE, LAMP, SQUARE_TABLE)}
TASK_NAMES = tuple(_TASKS)


def get_task(name: str) -> AssemblyTask:
    """Specification of the task called ``name``.

    Raises:
        ConfigError: If there is no such task.
    """
    try:
        return _TASKS[name]
    except (KeyError, TypeError):  # what is no text may not even be looked up
        raise ConfigError(f"unknown task '{printable(name)}'{did_you_mean(str(name), _TASKS)}") from None
