"""Configuration of the flows: one file is one run, and holds only what differs from the defaults."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, field_validator, model_validator

from flows.conditions import METHODS, Condition
from juicer.config import StrictConfig, override, parse_config, read_mapping
from juicer.critical_states import AnnotationConfig
from juicer.errors import ConfigError, did_you_mean
from juicer.ingestion import IngestionConfig
from juicer.policy.config import HorizonConfig, MLPConfig, PolicyConfig
from juicer.seed_ranges import SEED_RANGES, Purpose
from juicer.tasks.specification import Randomness
from juicer.training.config import OriginalStateNoise, PhysicalStateNoise, TrainingConfig, WindowConfig
from stages.augment import AugmentConfig
from stages.collect import CollectConfig
from stages.evaluate import EvaluateConfig
from stages.record import RecordConfig
from stages.select import SelectConfig
from stages.train import TrainConfig

BASE_KEY, TASKS_KEY = "base", "tasks"
MOST_ROUNDS = 100
_SCENE = {
    "task": ("record", "ingest", "collect", "evaluate"),
    "randomness": ("record", "collect", "evaluate"),
}
"""Sections that take over a value of the top level unless they set their own."""


class ChunkedConfig(TrainConfig):
    """Training of the regression baseline that predicts chunks."""

    policy: PolicyConfig = PolicyConfig(head=MLPConfig())


class UnchunkedConfig(TrainConfig):
    """Training of the regression baseline that predicts one action at a time."""

    policy: PolicyConfig = PolicyConfig(head=MLPConfig(), horizons=HorizonConfig(pred=1, action=1))
    training: TrainingConfig = TrainingConfig(windows=WindowConfig(back_padding=0))


class PoliciesConfig(StrictConfig):
    """The policies of the paper's comparison, and how each is trained.

    Attributes:
        diffusion: The method's own policy.
        mlp_chunked: The regression baseline that predicts chunks.
        mlp_unchunked: The regression baseline that predicts one action at a time.
        multitask: The policy for several tasks; a file about several trains it like ``diffusion`` if it is left out.
    """

    diffusion: TrainConfig = TrainConfig()
    mlp_chunked: ChunkedConfig = ChunkedConfig()
    mlp_unchunked: UnchunkedConfig = UnchunkedConfig()
    multitask: TrainConfig | None = None

    @model_validator(mode="after")
    def _are_what_they_are_called(self) -> Self:
        kinds = {"diffusion": "diffusion", "mlp_chunked": "mlp", "mlp_unchunked": "mlp", "multitask": "diffusion"}
        for name, kind in kinds.items():
            config: TrainConfig | None = getattr(self, name)
            if config is not None and (found := config.policy.head.kind) != kind:
                raise ValueError(f"{name}.policy.head must be of kind '{kind}', got '{found}'")
        if self.mlp_unchunked.policy.horizons.pred != 1:
            raise ValueError("mlp_unchunked.policy.horizons.pred must be 1; that is what unchunked means")
        return self


class LoopConfig(StrictConfig):
    """The whole loop, from demonstrations to an evaluated policy.

    Attributes:
        name: Name of the experiment.
        task: Assembly task; sections may set their own.
        randomness: Level of the initial states; sections may set their own.
        logs: Folder with operator logs of a human; if empty, the scripted operator records them.
        labels: File with critical states labelled by a human.
        record: What the scripted operator records.
        ingest: Which logs become demonstrations.
        annotate: How critical states are proposed.
        augment: Corrective episodes of the first training.
        augment_retraining: The same for retraining, if it differs (the paper's one_leg: 50, and then 150).
        train: The policies.
        state_noise: What the condition of that name adds to observed states.
        rounds: Turns of collect, select, train in the conditions that collect.
        collect: Rollouts of a turn.
        select: Which of them are kept.
        evaluate: The final measurement.
        mix: By task, the loops whose data a model for several tasks is trained on.
    """

    name: str = Field(default="juicer", pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$")
    task: str = "one_leg"
    randomness: Randomness = Randomness.LOW
    logs: Path | None = None
    labels: Path | None = None
    record: RecordConfig = RecordConfig()
    ingest: IngestionConfig = IngestionConfig()
    annotate: AnnotationConfig = AnnotationConfig()
    augment: AugmentConfig = AugmentConfig()
    augment_retraining: AugmentConfig | None = None
    train: PoliciesConfig = PoliciesConfig()
    state_noise: Annotated[PhysicalStateNoise | OriginalStateNoise, Field(discriminator="kind")] = PhysicalStateNoise()
    rounds: int = Field(default=1, gt=0, le=MOST_ROUNDS)
    collect: CollectConfig = CollectConfig()
    select: SelectConfig = SelectConfig()
    evaluate: EvaluateConfig = EvaluateConfig()
    mix: dict[str, LoopConfig] = Field(default={})

    @model_validator(mode="before")
    @classmethod
    def _share_scene(cls, content: Any) -> Any:
        if not isinstance(content, dict):
            return content
        shared = dict(content)
        for key, sections in _SCENE.items():
            if isinstance(value := content.get(key), str):
                for section in sections:
                    _set_default(shared, [*section.split("."), key], value)
        return shared

    def training(self, condition: Condition, seed: int) -> TrainConfig:
        """How a condition trains the model of a seed."""
        method = METHODS[condition]
        config: TrainConfig = getattr(self.train, method.policy)
        training = config.training
        if method.adds_noise:
            training = training.model_copy(update={"state_noise": self.state_noise})
        return config.model_copy(update={"training": training, "seed": config.seed + seed})

    def final_training(self, condition: Condition, seed: int) -> TrainConfig:
        """The same for the model that is evaluated, which may be one for several tasks."""
        config = self.train.multitask
        if config is None or not METHODS[condition].mixes:
            return self.training(condition, seed)
        return config.model_copy(update={"seed": config.seed + seed})

    def collection(self, seed: int, round_index: int) -> CollectConfig:
        """Rollouts of a turn; every model and turn starts from initial states of its own."""
        turn = seed * MOST_ROUNDS + round_index - 1
        return self.collect.model_copy(update={"first": self.collect.first + turn * self.collect.max_episodes})

    @property
    def largest_seed(self) -> int:
        """The last seed whose models find initial states to collect from; below 0 if there is none."""
        turns = (len(SEED_RANGES[Purpose.COLLECTION]) - self.collect.first) // self.collect.max_episodes
        return (turns - self.rounds) // MOST_ROUNDS


class CollectInferConfig(LoopConfig):
    """One model of one condition."""

    flow: Literal["collect_infer"] = "collect_infer"
    condition: Condition = Condition.TA_CI
    seed: int = Field(default=0, ge=0)

    def narrowed(self, condition: Condition | None, seed: int | None) -> CollectInferConfig:
        """The same for another condition or seed.

        Raises:
            ConfigError: If they do not go with the rest.
        """
        asked = {"condition": condition, "seed": seed}
        update = {key: value for key, value in asked.items() if value is not None}
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
        default=tuple(condition for condition in Condition if not METHODS[condition].mixes), min_length=1
    )
    seeds: tuple[Annotated[int, Field(ge=0)], ...] = Field(default=(0, 1, 2, 3, 4), min_length=1)

    def narrowed(self, condition: Condition | None, seed: int | None) -> StudyConfig:
        """The same with one condition or seed only.

        Raises:
            ConfigError: If the study has no such condition or seed.
        """
        if condition is not None and condition not in self.conditions:
            raise ConfigError(f"the study has no condition '{condition}'{did_you_mean(condition, self.conditions)}")
        if seed is not None and seed not in self.seeds:
            raise ConfigError(f"the study has no seed {seed}; its seeds are {', '.join(map(str, self.seeds))}")
        conditions = self.conditions if condition is None else (condition,)
        seeds = self.seeds if seed is None else (seed,)
        return self.model_copy(update={"conditions": conditions, "seeds": seeds})

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


def load_runs(path: Path, overrides: Sequence[str] = ()) -> tuple[RunConfig, ...]:
    """Read the configuration of a run, or of a run for each of several tasks.

    A file may name another as its ``base``, by a path relative to its own; what it says itself goes first.
    ``tasks`` is a list of tasks, or a mapping from tasks to what differs for each.

    Raises:
        ConfigError: If a file is missing, or a key or value is not valid.
    """
    content = read_mapping(path)
    if (base := content.pop(BASE_KEY, None)) is not None:
        below = read_mapping(path.parent / str(base))
        if BASE_KEY in below:
            raise ConfigError(f"config file '{path.parent / str(base)}' is a base itself and must not have one")
        content = _merge(below, content)
    content = override(content, overrides)
    flow = str(content.get("flow", "collect_infer"))
    if flow not in _FLOWS:
        raise ConfigError(f"{path}: unknown flow '{flow}'{did_you_mean(flow, _FLOWS)}")
    return tuple(parse_config(each, _FLOWS[flow], origin=str(path)) for each in _each_task(content, str(path)))


def _each_task(content: dict[str, Any], origin: str) -> list[dict[str, Any]]:
    """One configuration for each task; one with the condition ``multitask`` is told of all."""
    tasks = content.pop(TASKS_KEY, None)
    if tasks is None:
        return [content]
    own = _tasks(tasks)
    if not own or "task" in content:
        raise ConfigError(f"{origin}: 'tasks' must list tasks, or map them to what differs for each, without 'task'")
    name, mixes = content.get("name", "juicer"), _names_mix(content)
    if mixes:
        # Settled before the tasks have their say: it is one model, whichever of them asks for it.
        policies = content.get("train", {})
        if isinstance(policies, dict):
            one = policies.get("multitask") or policies.get("diffusion", {})
            content = content | {"train": policies | {"multitask": one}}
    each = [_merge(content, {"name": f"{name}_{task}", **of_task, "task": task}) for task, of_task in own.items()]
    if mixes:
        loops = {
            entry["task"]: {key: value for key, value in entry.items() if key in LoopConfig.model_fields}
            for entry in each
        }
        each = [{**entry, "mix": loops} for entry in each]
    return each


def _tasks(content: Any) -> dict[str, dict[str, Any]]:
    """What differs for each of the tasks; empty if the content says something else."""
    pairs: list[tuple[Any, Any]] = []
    if isinstance(content, list):
        pairs = [(task, {}) for task in content]
    elif isinstance(content, dict):
        pairs = [(task, {} if own is None else own) for task, own in content.items()]
    is_clear = all(isinstance(task, str) and isinstance(own, dict) for task, own in pairs)
    return dict(pairs) if is_clear else {}


def _names_mix(content: Mapping[str, Any]) -> bool:
    """Whether a configuration asks for a model for several tasks."""
    conditions = content.get("conditions")
    named = [content.get("condition"), *(conditions if isinstance(conditions, list) else ())]
    return Condition.MULTITASK in named


def _merge(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(below)
    for key, value in above.items():
        nested = isinstance(value, Mapping) and isinstance(merged.get(key), Mapping)
        merged[key] = _merge(merged[key], value) if nested else value
    return merged


def _set_default(content: dict[str, Any], path: Sequence[str], value: str) -> None:
    """Set a nested value unless it is there; sections on the way are copied, not changed."""
    head, *rest = path
    if not rest:
        content.setdefault(head, value)
        return
    section = content.get(head, {})
    if isinstance(section, dict):
        content[head] = dict(section)
        _set_default(content[head], rest, value)
