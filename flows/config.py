"""Configuration of the flows: one file is one run, and holds only what differs from the defaults."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Annotated, Any, Literal, Self

from pydantic import Field, ValidationInfo, field_serializer, field_validator, model_validator

from flows.analyses import SamplingAnalysis
from flows.conditions import MOST_DEFINITIONS, Condition, Name, check_known, defaults, defined, of_one_task, shipped
from flows.loop_config import LoopConfig
from flows.written import CHANGES_KEY, CONDITIONS_KEY
from juicer.config import Place, nowhere, parse_config
from juicer.errors import ConfigError, did_you_mean
from juicer.policy.config import sampled_in
from juicer.seed_ranges import SEED_RANGES, Purpose
from juicer.shifts import Shift
from juicer.study.curves import Curve, CurveConfig
from juicer.text import printable
from juicer.yaml_reading import Keys

MOST_SEEDS = 1000
MIX_KEY = "mix"

RunSeed = Annotated[int, Field(ge=0, le=1_000_000)]
"""Number of a model among those that are trained alike."""


class FlowConfig(LoopConfig):
    """What both flows have in common.

    Attributes:
        conditions: What conditions are made of, by name.
        shifted: Conditions whose models are measured under the shifts as well; if empty, all of them.
    """

    conditions: dict[Name, Condition] = Field(default={}, max_length=MOST_DEFINITIONS)
    shifted: tuple[Name, ...] = Field(default=(), max_length=MOST_DEFINITIONS)

    @field_validator("conditions", mode="before")
    @classmethod
    def _are_defined(cls, given: Any) -> Any:
        return defined(given)

    @field_validator("conditions")
    @classmethod
    def _settings_have_names_of_their_own(cls, conditions: dict[Name, Condition]) -> dict[Name, Condition]:
        named: dict[str, str] = {}
        for name, condition in conditions.items():
            setting = condition.setting_in_words
            if setting.name and named.setdefault(setting.name, setting.changes) != setting.changes:
                raise ValueError(
                    f"{name}: the setting '{setting.name}' is the name of other changes as well; "
                    "give each a name of its own"
                )
        return conditions

    @model_validator(mode="after")
    def _is_possible(self, info: ValidationInfo) -> Self:
        if not self.models:
            raise ValueError(_ONE_SEED.format(self.first_seed))
        _check_run(self, info.context or nowhere)
        stop = self.evaluate.stop
        settings = [self.method(name).setting_in_words for name in self.chosen]
        is_whole = len(self.nameable) == len(self.conditions)
        if stop and stop.width is None and is_whole and (len(set(settings)) == len(settings) or not stop.comparison):
            raise ValueError(
                "evaluate.stop settles nothing: say with evaluate.stop.width how narrow the interval is to be, or "
                "compare several conditions that differ in their method alone"
            )
        return self

    def method(self, name: str) -> Condition:
        """What a condition is made of, whether the configuration says it or juicer."""
        found = self.conditions.get(name) or shipped(name)
        assert found is not None, f"condition {name} was not checked"
        return found

    def loop(self, name: str, place: Place = nowhere) -> LoopConfig:
        """The loop of a condition's models: this one, with what the condition changes laid over it.

        Args:
            name: The condition.
            place: Where the values of this configuration were written.

        Raises:
            ConfigError: If a key or value among the changes is not valid.
        """
        condition, origin = self.method(name), f"{CONDITIONS_KEY}.{name}.{CHANGES_KEY}"

        def said_at(keys: Keys) -> str | None:
            found = place((CONDITIONS_KEY, name, CHANGES_KEY, *keys))
            return f"{found}: {origin}" if found else None

        if not condition.changes:
            return self
        whole: LoopConfig = self if condition.joint_policy else self.model_copy(update={MIX_KEY: {}})
        return whole.changed(condition.changes, origin, said_at)

    def shifts_of(self, name: str) -> Mapping[str, Shift]:
        """The shifts under which a condition's models are measured as well; those that it names itself always count."""
        is_asked = not self.shifted or name in self.shifted or "shifts" in self.method(name).changes
        return self.loop(name).shifts if is_asked else {}

    @property
    def nameable(self) -> Collection[str]:
        """Names of the conditions that what is said of them may name."""
        return self.conditions

    @property
    @abstractmethod
    def first_seed(self) -> int:
        """The seed whose models are analysed where not all are; conditions that replay have no other."""

    @property
    @abstractmethod
    def models(self) -> tuple[tuple[str, int], ...]:
        """Names of conditions, and seeds, to train; seeds outermost."""

    @property
    def chosen(self) -> tuple[str, ...]:
        """Names of the conditions that are trained, in order."""
        return tuple(dict.fromkeys(name for name, _ in self.models))

    @property
    def levels(self) -> tuple[str, ...]:
        """Randomness of the initial states that its models are evaluated on; several if conditions change it."""
        return tuple(dict.fromkeys(self.loop(name).evaluation.randomness.value for name in self.chosen))

    @property
    def drawn_curves(self) -> tuple[Curve, ...]:
        """Curves over conditions; one model makes none."""
        return ()

    @property
    def is_joint(self) -> bool:
        """Whether one of the models is for several tasks."""
        return any(self.method(name).joint_policy for name in self.chosen)

    def trimmed(self) -> Self:
        """The same without the other tasks, unless one of its models learns them all."""
        return self if self.is_joint else self.model_copy(update={MIX_KEY: {}})


class CollectInferConfig(FlowConfig):
    """One model of one condition."""

    flow: Literal["collect_infer"] = "collect_infer"
    condition: Name = "ta_ci"
    seed: RunSeed = 0

    def narrowed(self, conditions: Sequence[str], seeds: Sequence[int]) -> CollectInferConfig:
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
        return parse_config({**dict(self), **update}, CollectInferConfig, origin="the chosen part").trimmed()

    @model_validator(mode="before")
    @classmethod
    def _says_which_condition(cls, content: Any) -> Any:
        defines = isinstance(content, Mapping) and content.get("conditions")
        if defines and not (isinstance(defines, Mapping) and "condition" in content):
            raise ValueError("conditions are those of a study: add flow: study, or say which is trained as condition")
        return content

    @field_validator("condition")
    @classmethod
    def _is_known(cls, name: str, info: ValidationInfo) -> str:
        check_known(name, {**defaults()["conditions"], **info.data.get("conditions", {name: None})})
        return name

    @property
    def seeds(self) -> tuple[int, ...]:
        """The only seed."""
        return (self.seed,)

    @property
    def first_seed(self) -> int:
        """The only seed."""
        return self.seed

    @property
    def models(self) -> tuple[tuple[str, int], ...]:
        """The only model."""
        return ((self.condition, self.seed),)


class StudyConfig(FlowConfig):
    """Conditions times seeds, compared.

    Attributes:
        conditions: What is compared: what each condition is made of, by name.
        curves: By name, conditions that differ in one number, drawn over it.
        analysed_seed: The seed whose models are analysed where not those of every seed are, and the only one of what
            has no randomness; if empty, the first.
        left_out: Conditions that a part of a study leaves out; what was said of the whole may still name them.
    """

    flow: Literal["study"] = "study"
    conditions: dict[Name, Condition] = Field(default_factory=of_one_task, min_length=1, max_length=MOST_DEFINITIONS)
    seeds: tuple[RunSeed, ...] = Field(default=(0, 1, 2, 3, 4), min_length=1, max_length=MOST_SEEDS)
    curves: dict[Name, CurveConfig] = Field(default={}, max_length=MOST_DEFINITIONS)
    analysed_seed: RunSeed | None = None
    left_out: tuple[Name, ...] = Field(default=(), max_length=MOST_DEFINITIONS)

    @model_validator(mode="after")
    def _has_the_points_of_its_curves(self) -> Self:
        for name, curve in self.curves.items():
            for condition in curve.conditions:
                if condition not in self.conditions:
                    near = did_you_mean(condition, self.conditions)
                    raise ValueError(f"curves.{name}: unknown condition '{printable(condition)}'{near}")
            self._points(name)
        return self

    @field_validator("conditions")
    @classmethod
    def _can_be_told_apart(cls, conditions: dict[str, Condition]) -> dict[str, Condition]:
        titled: dict[str, str] = {}
        for name, own in conditions.items():
            other = titled.setdefault(own.title, name)
            if other != name:
                raise ValueError(f"'{other}' and '{name}' have the same title, '{own.title}'; give one of them another")
        return conditions

    @property
    def nameable(self) -> Collection[str]:
        """Those of the whole study."""
        return (*self.conditions, *self.left_out)

    @property
    def drawn_curves(self) -> tuple[Curve, ...]:
        """The curves, with the number of each of their conditions."""
        return tuple(
            Curve(name=name, title=curve.title, axis=curve.axis, fit=curve.fit, points=self._points(name))
            for name, curve in self.curves.items()
        )

    def _points(self, name: str) -> dict[str, float]:
        curve = self.curves[name]
        return {
            condition: curve.number(condition, self.loop(condition).model_dump(mode="json"), f"curves.{name}")
            for condition in curve.conditions
        }

    def narrowed(self, conditions: Sequence[str], seeds: Sequence[int]) -> StudyConfig:
        """The same with some conditions or seeds only, in the study's order; with all of them where none is given.

        Raises:
            ConfigError: If the study has no such condition or seed.
        """
        for name in conditions:
            if name not in self.conditions:
                shown = f"'{printable(name)}'{did_you_mean(name, self.conditions)}"
                raise ConfigError(f"the study has no condition {shown}")
        for seed in seeds:
            if seed not in self.seeds:
                raise ConfigError(f"the study has no seed {seed}; its seeds are {', '.join(map(str, self.seeds))}")
        kept = {name: own for name, own in self.conditions.items() if not conditions or name in conditions}
        curves = {name: curve.narrowed(kept) for name, curve in self.curves.items()}
        part = self.model_copy(
            update={
                "conditions": kept,
                "left_out": (*self.left_out, *(name for name in self.conditions if name not in kept)),
                "seeds": tuple(each for each in self.seeds if not seeds or each in seeds),
                # Of a study that is run in parts, no part analyses more than the whole.
                "analysed_seed": self.first_seed if seeds else self.analysed_seed,
                "curves": {name: curve for name, curve in curves.items() if curve.conditions},
            }
        )
        if not part.models:
            raise ConfigError(_ONE_SEED.format(self.first_seed))
        return part.trimmed()

    @field_validator("seeds")
    @classmethod
    def _are_distinct(cls, values: tuple[Any, ...]) -> tuple[Any, ...]:
        if len(set(values)) < len(values):
            raise ValueError("each may be named only once")
        return values

    @field_serializer("conditions")
    def _as_written(self, conditions: dict[str, Condition]) -> list[str] | dict[str, Any]:
        """Names alone, if all of them are as they come with juicer."""
        if all(own == shipped(name) for name, own in conditions.items()):
            return list(conditions)
        return {name: own.model_dump(mode="json") for name, own in conditions.items()}

    @property
    def first_seed(self) -> int:
        """The first of the whole study."""
        return self.seeds[0] if self.analysed_seed is None else self.analysed_seed

    @property
    def models(self) -> tuple[tuple[str, int], ...]:
        """Conditions and seeds to train, seeds outermost; what has no randomness has the study's first seed only."""
        return tuple(
            (name, seed)
            for seed in self.seeds
            for name, condition in self.conditions.items()
            if seed == self.first_seed or not condition.replay
        )


RunConfig = CollectInferConfig | StudyConfig


_ONE_SEED = "there is nothing to run: a condition that replays has seed {} only, which is not one of the seeds"


def _check_run(config: FlowConfig, place: Place) -> None:
    """Refuse at once what would otherwise be noticed after a training.

    Raises:
        ValueError: If a condition has no such policy, a model is for several tasks and there are none, finds no initial
            states to collect from or to be evaluated on, or cannot be analysed as it is asked.
        ConfigError: If what a condition changes is not valid.
    """
    largest: float = math.inf
    _check_known(config, "shifted", config.shifted)
    for name in config.chosen:
        condition, loop = config.method(name), config.loop(name, place)
        if condition.joint_policy and len(config.mix) < 2:
            raise ValueError(f"condition {name} needs several tasks; the file that names it must list them under tasks")
        loops = (loop, *(loop.mix.values() if condition.joint_policy else ()))
        for policy in (condition.policy, condition.joint_policy or condition.policy):
            for each in loops:
                if policy not in each.policies:
                    near = did_you_mean(policy, each.policies)
                    raise ValueError(f"conditions.{name}: there is no policy '{policy}'{near}")
        where = f"conditions.{name}.changes: " if condition.changes else ""
        for each in loops:
            _check_states(each, where)
        _check_analyses(config, name, loop, where)
        if condition.collect:
            largest = min(largest, *(each.largest_seed(condition) for each in loops), math.inf)
    seed = max(seed for _, seed in config.models)
    if largest < 0:
        raise ValueError("initial states to collect from run out; lower collect.max_episodes, collect.first or rounds")
    if seed > largest:
        raise ValueError(
            f"seed {seed} is too large: there are initial states to collect from for seeds up to {largest}; "
            "take a smaller seed, or lower collect.max_episodes"
        )


def _check_known(config: FlowConfig, where: str, conditions: Iterable[str]) -> None:
    for name in conditions:
        if name not in config.nameable and shipped(name) is None:
            near = did_you_mean(name, {*defaults()["conditions"], *config.nameable})
            raise ValueError(f"{where}: there is no condition '{name}'{near}")


def _check_states(loop: LoopConfig, where: str) -> None:
    if loop.evaluate.first + loop.evaluate.episodes > len(SEED_RANGES[Purpose.EVALUATION]):
        raise ValueError(f"{where}initial states to evaluate on run out; lower evaluate.first or evaluate.episodes")
    if loop.logs is None and loop.record.first + loop.record.max_recordings > len(SEED_RANGES[Purpose.DEMONSTRATIONS]):
        raise ValueError(f"{where}initial states to record from run out; lower record.first or record.max_recordings")


def _check_analyses(config: FlowConfig, name: str, loop: LoopConfig, where: str) -> None:
    policy = loop.final_training(config.method(name), 0).policy
    for key, analysis in loop.analyses.items():
        _check_known(config, f"{where}analyses.{key}.conditions", analysis.conditions)
        if not (policy.draws_samples and analysis.concerns(name, is_first_seed=True)):
            continue
        if isinstance(analysis, SamplingAnalysis):
            try:
                sampled_in(policy, max(analysis.inference_steps))
            except ConfigError as error:
                raise ValueError(f"{where}analyses.{key}.inference_steps: {error}") from None
        elif loop.evaluate.first + (analysis.episodes or 0) > len(SEED_RANGES[Purpose.EVALUATION]):
            raise ValueError(
                f"{where}initial states to evaluate on run out; lower evaluate.first or analyses.{key}.episodes"
            )
