"""Configuration of the flows: one file is one run, and holds only what differs from the defaults."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, field_validator, model_validator

from flows.conditions import METHODS, Condition
from flows.loop_config import LoopConfig
from flows.written import TASKS_KEY, Written, read_written, take_written
from juicer.config import parse_config
from juicer.errors import ConfigError, did_you_mean
from juicer.seed_ranges import SEED_RANGES, Purpose
from juicer.tasks.registry import TASK_NAMES
from juicer.text import printable

MOST_SEEDS = 1000
FLOW_KEY = "flow"
MIX_KEY = "mix"
DEFAULT_FLOW = "collect_infer"

RunSeed = Annotated[int, Field(ge=0, le=1_000_000)]
"""Number of a model among those that are trained alike."""


class CollectInferConfig(LoopConfig):
    """One model of one condition."""

    flow: Literal["collect_infer"] = "collect_infer"
    condition: Condition = Condition.TA_CI
    seed: RunSeed = 0

    def narrowed(self, conditions: Sequence[Condition], seeds: Sequence[int]) -> CollectInferConfig:
        """The same for another condition or seed; as it is where none is given.

        Raises:
            ConfigError: If they do not go with the rest, or are several.
        """
        update: dict[str, Any] = {}
        for key, values in {"condition": conditions, "seed": seeds}.items():
            if len(values) > 1:
                raise ConfigError(
                    f"this configuration is of one model: give one {key}, or make it a study (flow: study)"
                )
            if values:
                update[key] = values[0]
        return parse_config({**dict(self), **update}, CollectInferConfig, origin="the chosen part")

    @model_validator(mode="after")
    def _is_possible(self) -> Self:
        _check_run(self)
        return self

    @property
    def conditions(self) -> tuple[Condition, ...]:
        """The only condition."""
        return (self.condition,)

    @property
    def seeds(self) -> tuple[int, ...]:
        """The only seed."""
        return (self.seed,)

    @property
    def models(self) -> tuple[tuple[Condition, int], ...]:
        """The only model."""
        return ((self.condition, self.seed),)


class StudyConfig(LoopConfig):
    """Conditions times seeds, compared."""

    flow: Literal["study"] = "study"
    conditions: tuple[Condition, ...] = Field(
        default=tuple(condition for condition in Condition if not METHODS[condition].mixes),
        min_length=1,
        max_length=len(Condition),
    )
    seeds: tuple[RunSeed, ...] = Field(default=(0, 1, 2, 3, 4), min_length=1, max_length=MOST_SEEDS)

    def narrowed(self, conditions: Sequence[Condition], seeds: Sequence[int]) -> StudyConfig:
        """The same with some conditions or seeds only, in the study's order; with all of them where none is given.

        Raises:
            ConfigError: If the study has no such condition or seed.
        """
        for condition in conditions:
            if condition not in self.conditions:
                raise ConfigError(f"the study has no condition '{condition}'{did_you_mean(condition, self.conditions)}")
        for seed in seeds:
            if seed not in self.seeds:
                raise ConfigError(f"the study has no seed {seed}; its seeds are {', '.join(map(str, self.seeds))}")
        return self.model_copy(
            update={
                "conditions": tuple(each for each in self.conditions if not conditions or each in conditions),
                "seeds": tuple(each for each in self.seeds if not seeds or each in seeds),
            }
        )

    @model_validator(mode="after")
    def _is_possible(self) -> Self:
        _check_run(self)
        return self

    @field_validator("conditions", "seeds")
    @classmethod
    def _are_distinct(cls, values: tuple[Any, ...]) -> tuple[Any, ...]:
        if len(set(values)) < len(values):
            raise ValueError("each may be named only once")
        return values

    @property
    def models(self) -> tuple[tuple[Condition, int], ...]:
        """Conditions and seeds to train, seeds outermost; what has no randomness has the first seed only."""
        return tuple(
            (condition, seed)
            for seed in self.seeds
            for condition in self.conditions
            if seed == self.seeds[0] or not METHODS[condition].replays
        )


RunConfig = CollectInferConfig | StudyConfig
_FLOWS: Mapping[str, type[CollectInferConfig] | type[StudyConfig]] = {
    "collect_infer": CollectInferConfig,
    "study": StudyConfig,
}


def _check_run(config: RunConfig) -> None:
    """Refuse at once what would otherwise be noticed after a training.

    Raises:
        ValueError: If a model is for several tasks and there are none, or finds no initial states to collect from or to
            be evaluated on.
    """
    methods = [METHODS[condition] for condition in config.conditions]
    if any(method.mixes for method in methods) and len(config.mix) < 2:
        raise ValueError("condition multitask needs several tasks; the file that names it must list them under tasks")
    collecting = [
        loop for method in methods if method.collects for loop in (config.mix.values() if method.mixes else (config,))
    ]
    largest, seed = min((loop.largest_seed for loop in collecting), default=math.inf), max(config.seeds)
    if largest < 0:
        raise ValueError("initial states to collect from run out; lower collect.max_episodes, collect.first or rounds")
    if seed > largest:
        raise ValueError(
            f"seed {seed} is too large: there are initial states to collect from for seeds up to {largest}; "
            "take a smaller seed, or lower collect.max_episodes"
        )
    if config.evaluate.first + config.evaluate.episodes > len(SEED_RANGES[Purpose.EVALUATION]):
        raise ValueError("initial states to evaluate on run out; lower evaluate.first or evaluate.episodes")
    if config.logs is None and config.record.first + config.record.max_recordings > len(
        SEED_RANGES[Purpose.DEMONSTRATIONS]
    ):
        raise ValueError("initial states to record from run out; lower record.first or record.max_recordings")


def load_runs(source: Path | str, overrides: Sequence[str] = ()) -> tuple[RunConfig, ...]:
    """Read the configuration of a run, or of a run for each of several tasks.

    Args:
        source: A file, or the name of a configuration that comes with juicer.
        overrides: Values that go first, as ``dotted.key=value``.

    Raises:
        ConfigError: If a file is missing, or a key or value is not valid.
    """
    return runs_of(read_written(source).assigning(overrides, Path.cwd()), str(source))


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
    return runs_of(take_written(content, origin).assigning(overrides, None), origin)


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
    return tuple(parse_config(each.values, _FLOWS[flow], origin, each.place) for each in _each_task(written, origin))


def _each_task(written: Written, origin: str) -> list[Written]:
    """One configuration for each task; one with the condition ``multitask`` is told of all."""
    if written.values.get(TASKS_KEY) is None:
        return [written.without(TASKS_KEY)]
    names = task_names(written, origin)
    common = written.without(TASKS_KEY)
    is_mapping = isinstance(written.values[TASKS_KEY], Mapping)
    own = {task: written.below(TASKS_KEY, task) if is_mapping else Written({}) for task in names}
    mixes = names_mix(written)
    if mixes:
        # Settled before the tasks have their say: it is one model, whichever of them asks for it.
        policies = common.values.get("train", {})
        if isinstance(policies, Mapping):
            one = policies.get("multitask") or policies.get("diffusion", {})
            common = Written({**common.values, "train": {**policies, "multitask": one}}, common.places)
    name = common.values.get("name", LoopConfig.model_fields["name"].default)
    each = []
    for task, differing in own.items():
        given = {"name": f"{name}_{task}"} if isinstance(name, str) else {}
        each.append(Written({**given, **differing.values, "task": task}, differing.places).over(common))
    if mixes:
        fields = LoopConfig.model_fields
        loops = {
            loop.values["task"]: {key: value for key, value in loop.values.items() if key in fields} for loop in each
        }
        each = [Written({**loop.values, "mix": loops}, loop.places) for loop in each]
    return each


def task_names(written: Written, origin: str) -> list[str]:
    """Names under ``tasks``.

    Raises:
        ConfigError: If they are no tasks, one is there twice, or the task is said elsewhere too.
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


def names_mix(written: Written) -> bool:
    """Whether a configuration asks for a model for several tasks."""
    conditions = written.values.get("conditions")
    named: Iterable[Any] = conditions if isinstance(conditions, list) else ()
    return Condition.MULTITASK in [written.values.get("condition"), *named]
