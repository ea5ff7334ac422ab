"""What was written, narrowed to a part of it: a configuration that is just this part."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from flows.config import StudyConfig
from flows.written import CONDITIONS_KEY, TASKS_KEY, Written

SEEDS_KEY, CURVES_KEY = "seeds", "curves"


def with_tasks(written: Written, tasks: Collection[str]) -> Written:
    """The same with some of its tasks."""
    said = written.values[TASKS_KEY]
    names = [task for task in said if task in tasks]
    kept = {task: said[task] for task in names} if isinstance(said, Mapping) else names
    return replace(written, values={**written.values, TASKS_KEY: kept})


def with_model(written: Written, conditions: Sequence[str], seeds: Sequence[int]) -> Written:
    """The same for another condition or seed, of which there is one at most, also where a task has its own."""
    for key, option, chosen in (("condition", "--condition", conditions), ("seed", "--seed", seeds)):
        own = [(TASKS_KEY, task) for task, said in written.sections(TASKS_KEY).items() if key in (said or {})]
        for value in chosen:
            for outer in ((), *own):
                written = written.replacing((*outer, key), value, option)
    return written


def with_conditions(written: Written, whole: Sequence[StudyConfig], names: Sequence[str]) -> Written:
    """The same with some conditions, in the study's order; a task need not have them all.

    Args:
        written: What was written of the whole study.
        whole: The run for each of its tasks.
        names: Of the conditions.
    """
    result = _saying(written, CONDITIONS_KEY, (name for run in whole for name in run.conditions))
    for section in _sections(written):
        result = _keeping(result, (*section, CONDITIONS_KEY), names, "--condition")
        for curve in result.below(*section).sections(CURVES_KEY):
            result = _keeping(result, (*section, CURVES_KEY, curve, CONDITIONS_KEY), names, "--condition")
        curves = result.below(*section).sections(CURVES_KEY)
        with_points = [curve for curve, own in curves.items() if CONDITIONS_KEY in (own or {})]
        result = _keeping(result, (*section, CURVES_KEY), with_points, "--condition")
    parts = [run.narrowed([name for name in names if name in run.conditions], []) for run in whole]
    return _as_in_parts(result, {part.task: list(part.left_out) for part in parts}, "left_out", "--condition")


def with_seeds(written: Written, whole: Sequence[StudyConfig], seeds: Sequence[int]) -> Written:
    """The same with some seeds, in the study's order; a task need not have them all.

    Args:
        written: What was written of the whole study.
        whole: The run for each of its tasks.
        seeds: Their numbers.
    """
    result = _saying(written, SEEDS_KEY, (seed for run in whole for seed in run.seeds))
    for section in _sections(written):
        result = _keeping(result, (*section, SEEDS_KEY), seeds, "--seed")
    return _as_in_parts(result, {run.task: run.first_seed for run in whole}, "analysed_seed", "--seed")


def _sections(written: Written) -> list[tuple[str, ...]]:
    """Where something is said: of all tasks, and of each."""
    return [(), *((TASKS_KEY, task) for task in written.sections(TASKS_KEY))]


def _saying(written: Written, key: str, default: Iterable[str | int]) -> Written:
    """The same with what it leaves open, as one can only take away from what is said."""
    return Written({key: list(dict.fromkeys(default)), **written.values}, written.places)


def _keeping(written: Written, keys: tuple[str, ...], entries: Collection[str | int], option: str) -> Written:
    """The same with some entries of a list or section, and without it where none of them is there."""
    said = written.value(keys)
    if not isinstance(said, Mapping | list | tuple):
        return written
    if kept := [each for each in said if each in entries]:
        return written.replacing(keys, kept, option)
    *outer, key = keys
    return written.with_section(outer, written.below(*outer).without(key)) if outer else written.without(key)


def _as_in_parts(written: Written, values: Mapping[str, Any], key: str, option: str) -> Written:
    """The same with a value by task, said once for all tasks that have the first one's."""
    common = next(iter(values.values()))
    written = written.replacing((key,), common, option)
    for task, value in values.items():
        if value != common or written.holds((TASKS_KEY, task, key)):
            written = written.replacing((TASKS_KEY, task, key), value, option)
    return written
