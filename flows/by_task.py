"""What a configuration says of single tasks, whichever run is for them: a preset trains longer for the longer ones."""

from __future__ import annotations

from collections.abc import Mapping

from flows.written import BY_TASK_KEY, TASKS_KEY, Written
from juicer.errors import ConfigError, did_you_mean
from juicer.tasks.registry import TASK_NAMES
from juicer.text import printable

_OF_THE_RUN = ("task", TASKS_KEY, BY_TASK_KEY, "flow", "name")


def lay_over(above: Written, below: Written) -> Written:
    """One content laid over another; what it says of all tasks goes before what the other says of one."""
    return above.over(give_way(below, above))


def give_way(written: Written, above: Written) -> Written:
    """The same where what is said of single tasks gives way to what is said above of all."""
    for task, said in written.sections(BY_TASK_KEY).items():
        if said:
            own = written.below(BY_TASK_KEY, task).giving_way(above)
            written = written.with_section((BY_TASK_KEY, task), own)
    return written


def for_its_tasks(written: Written) -> Written:
    """The same with what it says by task said of the run, or the runs, that are for these tasks.

    Raises:
        ConfigError: If it is said of what is not a task, or says what no task has for itself.
    """
    if BY_TASK_KEY not in written.values:
        return written
    _check(written)
    by_task, rest = written.below(BY_TASK_KEY), written.without(BY_TASK_KEY)
    tasks = written.values.get(TASKS_KEY)
    if tasks is None:
        task = written.values.get("task", TASK_NAMES[0])
        return by_task.below(task).over(rest) if task in TASK_NAMES else rest
    if isinstance(tasks, list) and all(task in TASK_NAMES for task in tasks) and len(set(tasks)) == len(tasks):
        place = rest.place((TASKS_KEY,))
        rest = rest.with_section((TASKS_KEY,), Written({task: {} for task in tasks}, {(): place} if place else {}))
    for task in rest.sections(TASKS_KEY):
        rest = rest.with_section((TASKS_KEY, task), rest.below(TASKS_KEY, task).over(by_task.below(task)))
    return rest


def _check(written: Written) -> None:
    own = written.values[BY_TASK_KEY] or {}
    remedy = f"{BY_TASK_KEY} must map tasks to what is said of each"
    if not isinstance(own, Mapping):
        raise ConfigError(f"{written.place((BY_TASK_KEY,))}: {remedy}")
    for task, said in own.items():
        place = written.place((BY_TASK_KEY, task))
        if not isinstance(said, Mapping | None):
            raise ConfigError(f"{place}: {remedy}")
        if task not in TASK_NAMES:
            raise ConfigError(
                f"{place}: {BY_TASK_KEY}: unknown task '{printable(task)}'{did_you_mean(task, TASK_NAMES)}"
            )
        if wrong := next((key for key in _OF_THE_RUN if key in (said or {})), None):
            raise ConfigError(f"{place}: {BY_TASK_KEY}.{task} must not have a '{wrong}' of its own")
