"""The runs that a configuration describes: one, or one for each of several tasks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from flows.config import MIX_KEY, CollectInferConfig, RunConfig, StudyConfig
from flows.loop_config import LoopConfig
from flows.reading import read_written, take_written
from flows.written import TASKS_KEY, Written, settled
from juicer.config import parse_config
from juicer.errors import ConfigError, did_you_mean
from juicer.tasks.registry import TASK_NAMES
from juicer.text import printable

FLOW_KEY = "flow"
DEFAULT_FLOW = "collect_infer"
_FLOWS: Mapping[str, type[CollectInferConfig] | type[StudyConfig]] = {
    "collect_infer": CollectInferConfig,
    "study": StudyConfig,
}


def load_runs(source: Path | str, overrides: Sequence[str] = ()) -> tuple[RunConfig, ...]:
    """Read the configuration of a run, or of a run for each of several tasks.

    Args:
        source: A file, or the name of a configuration that comes with juicer.
        overrides: Values that go first, as ``dotted.key=value``.

    Raises:
        ConfigError: If a file is missing, or a key or value is not valid.
    """
    return runs_of(read_written(source, overrides), str(source))


def parse_runs(content: Mapping[str, Any] | str, origin: str, overrides: Sequence[str] = ()) -> tuple[RunConfig, ...]:
    """The same for a configuration that stands in no file, such as one pasted into a form.

    Args:
        content: What a file would hold, as keys and values or as YAML; paths in it must be absolute, a base may be the
            name of a preset.
        origin: What to call it in errors.
        overrides: Values that go first, as ``dotted.key=value``; paths in them must be absolute, too.

    Raises:
        ConfigError: If a key or value is not valid.
    """
    return runs_of(take_written(content, origin, overrides), origin)


def runs_of(written: Written, origin: str) -> tuple[RunConfig, ...]:
    """The runs that a configuration describes.

    ``tasks`` is a list of tasks, or a mapping from tasks to what differs for each.

    Raises:
        ConfigError: If a key or value is not valid.
    """
    flow = written.values.get(FLOW_KEY, DEFAULT_FLOW)
    if not isinstance(flow, str) or flow not in _FLOWS:
        raise ConfigError(
            f"{written.place((FLOW_KEY,)) or origin}: unknown flow '{printable(flow)}'{did_you_mean(str(flow), _FLOWS)}"
        )
    if MIX_KEY in written.values and TASKS_KEY in written.values:
        place = written.place((MIX_KEY,)) or origin
        raise ConfigError(f"{place}: key 'mix' does not go with tasks, which it is made of; leave it out")
    if TASKS_KEY not in written.values or written.values[TASKS_KEY] is None:
        only = settled(written.without(TASKS_KEY))
        return (parse_config(only.values, _FLOWS[flow], origin, only.place),)
    each = _each_task(written, origin)
    fields = LoopConfig.model_fields
    loops = {
        task: parse_config({key: own.values[key] for key in own.values if key in fields}, LoopConfig, origin, own.place)
        for task, own in each.items()
    }
    runs = [parse_config({**own.values, MIX_KEY: loops}, _FLOWS[flow], origin, own.place) for own in each.values()]
    return tuple(run.trimmed() for run in runs)


def _each_task(written: Written, origin: str) -> dict[str, Written]:
    """By task, what was written for all of them and what differs for it."""
    names = task_names(written, origin)
    # The policies are settled before the tasks have their say: one for several tasks is the same whoever asks for it.
    common = settled(written.without(TASKS_KEY))
    name = common.values.get("name", LoopConfig.model_fields["name"].default)
    each = {}
    for task in names:
        own = written.below(TASKS_KEY, task) if isinstance(written.values[TASKS_KEY], Mapping) else Written({})
        given = {"name": f"{name}_{task}"} if isinstance(name, str) else {}
        each[task] = settled(Written({**given, **own.values, "task": task}, own.places).over(common))
    return each


def task_names(written: Written, origin: str) -> list[str]:
    """Names under ``tasks``.

    Raises:
        ConfigError: If one of them is not a task, one is there twice, or the task is said elsewhere too.
    """
    tasks = written.values.get(TASKS_KEY)
    place = written.place((TASKS_KEY,)) or origin
    names = list(tasks) if isinstance(tasks, list | Mapping) else []
    sections = list(tasks.values()) if isinstance(tasks, Mapping) else []
    are_clear = all(isinstance(name, str) for name in names) and all(
        own is None or isinstance(own, Mapping) for own in sections
    )
    if not names or not are_clear or "task" in written.values:
        raise ConfigError(f"{place}: 'tasks' must list tasks, or map them to what differs for each, without 'task'")
    for name in names:
        if name not in TASK_NAMES:
            raise ConfigError(f"{place}: unknown task '{printable(name)}'{did_you_mean(name, TASK_NAMES)}")
        if names.count(name) > 1:
            raise ConfigError(f"{place}: tasks: each may be named only once, and {name} is there twice")
        for key in ("task", TASKS_KEY, FLOW_KEY):
            if key in written.below(TASKS_KEY, name).values:
                raise ConfigError(f"{place}: tasks.{name} must not have a '{key}' of its own")
    return names
