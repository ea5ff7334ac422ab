"""What was written, narrowed to a part of it: a configuration that is just this part."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

from flows.config import StudyConfig
from flows.written import CONDITIONS_KEY, TASKS_KEY, Written

SEEDS_KEY, CURVES_KEY = "seeds", "curves"
_OPTIONS = {CONDITIONS_KEY: "--condition", SEEDS_KEY: "--seed"}
_SETTLED = {CONDITIONS_KEY: "left_out", SEEDS_KEY: "analysed_seed"}
"""What a part says of the whole when some of these are chosen."""


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


def with_part(
    written: Written, whole: Sequence[StudyConfig], conditions: Sequence[str], seeds: Sequence[int]
) -> Written:
    """The same with some conditions and seeds, in the study's order.

    Args:
        written: What was written of the whole study.
        whole: The run for each of its tasks.
        conditions: Their names; all of them where there are none. A task need not have them all.
        seeds: Their numbers; all of them where there are none.
    """
    chosen: dict[str, Sequence[str] | Sequence[int]] = {CONDITIONS_KEY: conditions, SEEDS_KEY: seeds}
    chosen = {key: entries for key, entries in chosen.items() if entries}
    unsaid = {key: list(dict.fromkeys(each for run in whole for each in getattr(run, key))) for key in chosen}
    result = _narrowed(Written({**unsaid, **written.values}, written.places), chosen)
    for task in written.sections(TASKS_KEY):
        own = _narrowed(written.below(TASKS_KEY, task), chosen).without(*(_SETTLED[key] for key in chosen))
        result = result.with_section((TASKS_KEY, task), own)
    parts = [
        run.narrowed([name for name in conditions if name in run.conditions], [n for n in seeds if n in run.seeds])
        for run in whole
    ]
    for key in chosen:
        option, told = _OPTIONS[key], _SETTLED[key]
        settled = {part.task: part.model_dump(mode="json", include={told})[told] for part in parts}
        common = settled[parts[0].task]
        result = result.replacing((told,), common, option)
        for task in (part.task for part in parts if settled[part.task] != common):
            result = result.replacing((TASKS_KEY, task, told), settled[task], option)
    return result


def _narrowed(section: Written, chosen: Mapping[str, Sequence[str] | Sequence[int]]) -> Written:
    """What is said of all tasks, or of one, without what is not chosen."""
    for key, entries in chosen.items():
        section = _keeping(section, key, entries, _OPTIONS[key])
    if CONDITIONS_KEY not in chosen:
        return section
    for name in section.sections(CURVES_KEY):
        curve = section.below(CURVES_KEY, name)
        curve = _keeping(curve, CONDITIONS_KEY, chosen[CONDITIONS_KEY], _OPTIONS[CONDITIONS_KEY])
        section = section.with_section((CURVES_KEY, name), curve)
    with_points = [name for name, curve in section.sections(CURVES_KEY).items() if CONDITIONS_KEY in (curve or {})]
    return _keeping(section, CURVES_KEY, with_points, _OPTIONS[CONDITIONS_KEY])


def _keeping(section: Written, key: str, entries: Collection[str | int], option: str) -> Written:
    """A section with some entries of a list, or of a section in it, and without it where none of them is there."""
    said = section.values.get(key)
    if not isinstance(said, Mapping | list | tuple):
        return section
    kept = [each for each in said if each in entries]
    return section.replacing((key,), kept, option) if kept else section.without(key)
