"""Configuration of the loop: its sections, and what each stage of it is given."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self, get_origin

from pydantic import Field, field_validator, model_validator

from flows.analyses import AnyAnalysis
from flows.conditions import MOST_DEFINITIONS, MOST_ROUNDS, Condition, Name, defaults
from flows.stopping import StoppableSection
from flows.written import DEFAULT_NAME, POLICIES_KEY, Written, settled
from juicer.annotation.propose import AnnotationConfig
from juicer.config import ConfigT, Place, StrictConfig, parse_config
from juicer.demonstration.ingestion import IngestionConfig, IngestionSection
from juicer.seed_ranges import SEED_RANGES, Purpose
from juicer.shifts import Shift
from juicer.tasks.registry import TASK_NAMES
from juicer.tasks.specification import Randomness
from juicer.tasks.task_name import TaskName
from juicer.text import printable
from juicer.training.config import OriginalStateNoise, PhysicalStateNoise
from juicer.training.mixing import DatasetConfig
from stages.augment import AugmentConfig
from stages.collect import CollectConfig, CollectSection
from stages.correct import CorrectConfig, CorrectSection
from stages.evaluate import EvaluateConfig
from stages.record import RecordConfig, RecordSection
from stages.select import SelectConfig
from stages.train import TrainConfig

LONGEST_PATH, LONGEST_NAME = 4000, 255
DATA_KEYS = (
    "randomness",
    "record",
    "ingest",
    "annotate",
    "augment",
    "augment_retraining",
    "dataset",
    "rounds",
    "collect",
    "select",
    "correct",
)
"""Keys that say what models learn from, beside the logs and labels of people."""


def _default_policies() -> dict[str, Any]:
    return dict(settled(Written({POLICIES_KEY: defaults()[POLICIES_KEY]})).values[POLICIES_KEY])


class LoopConfig(StrictConfig):
    """The whole loop, from demonstrations to an evaluated policy.

    Attributes:
        name: Name of the experiment.
        task: Assembly task, for all sections.
        randomness: Level of the initial states; sections may set their own.
        logs: Folder with operator logs of a human; if empty, the scripted operator records them.
        labels: File with critical states labelled by a human.
        record: What the scripted operator records.
        ingest: Which logs become demonstrations.
        annotate: How critical states are proposed.
        augment: Corrective episodes of the first training.
        augment_retraining: The same for retraining, if it differs (the paper's one_leg: 50, and then 150).
        dataset: Which of the episodes that there are in the end are learned from, and how much each counts.
        policies: By name, what is trained and how.
        state_noise: What is added to observed states in the conditions that ask for it.
        rounds: Turns of collect, select, train in the conditions that collect and have no number of their own.
        collect: Rollouts of a turn.
        select: Which of them are kept.
        correct: How many of the others an operator finishes, in the conditions that ask for it.
        evaluate: The final measurement.
        analyses: By name, what is to be known of the models beside their success rates.
        shifts: By name, in what else the scene differs from training when every model is measured once more.
        mix: By task, the loops whose data a model for several tasks is trained on.
    """

    renamed: ClassVar[Mapping[str, str]] = {"train": "'policies', as in policies.diffusion.training.steps"}

    name: str = Field(default=DEFAULT_NAME, max_length=100)
    task: TaskName = "one_leg"
    randomness: Randomness = Randomness.LOW
    logs: Path | None = None
    labels: Path | None = None
    record: RecordSection = RecordSection()
    ingest: IngestionSection = IngestionSection()
    annotate: AnnotationConfig = AnnotationConfig()
    augment: AugmentConfig = AugmentConfig()
    augment_retraining: AugmentConfig | None = None
    dataset: DatasetConfig = DatasetConfig()
    policies: dict[Name, TrainConfig] = Field(default_factory=_default_policies, max_length=MOST_DEFINITIONS)
    state_noise: Annotated[PhysicalStateNoise | OriginalStateNoise, Field(discriminator="kind")] = PhysicalStateNoise()
    rounds: int = Field(default=1, gt=0, le=MOST_ROUNDS)
    collect: CollectSection = CollectSection()
    select: SelectConfig = SelectConfig()
    correct: CorrectSection = CorrectSection()
    evaluate: StoppableSection = StoppableSection()
    analyses: dict[Name, AnyAnalysis] = Field(default={}, max_length=MOST_DEFINITIONS)
    shifts: dict[Name, Shift] = Field(default={}, max_length=MOST_DEFINITIONS)
    mix: dict[TaskName, LoopConfig] = Field(default={}, max_length=len(TASK_NAMES))

    @model_validator(mode="before")
    @classmethod
    def _says_the_task_once(cls, content: Any) -> Any:
        for section, own in content.items() if isinstance(content, Mapping) else ():
            if not isinstance(own, Mapping) or "task" not in own:
                continue
            field = cls.model_fields.get(section)
            holds_names = field is not None and get_origin(field.annotation) is dict
            # What people name may be called task, too.
            if not (holds_names and isinstance(own["task"], Mapping)):
                raise ValueError(f"{printable(section)}.task: the task is said once, at the top of the configuration")
        return content

    @field_validator("name")
    @classmethod
    def _fits_everywhere(cls, name: str) -> str:
        if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]*", name):
            raise ValueError("must be letters, digits, '_', '.' and '-', a letter or digit first")
        return name

    @field_validator("logs", "labels")
    @classmethod
    def _can_be_a_path(cls, path: Path | None) -> Path | None:
        if path is None:
            return None
        try:
            parts = [os.fsencode(part) for part in path.parts]
        except UnicodeEncodeError:
            parts = [b"\0"]
        if b"\0" in b"".join(parts) or len(str(path)) > LONGEST_PATH or max(map(len, parts), default=0) > LONGEST_NAME:
            raise ValueError("must be the path of a file or folder")
        return path

    @model_validator(mode="after")
    def _mixes_loops_of_one_task_each(self) -> Self:
        for task, loop in self.mix.items():
            if loop.task != task or loop.mix:
                raise ValueError(f"mix.{task} must be the loop of {task} alone")
        return self

    @model_validator(mode="after")
    def _shifts_are_possible(self) -> Self:
        for shift in self.shifts.values():
            shift.check(self.evaluation.randomness)
        return self

    def changed(self, changes: Mapping[str, Any], origin: str, place: Place) -> LoopConfig:
        """The same with other values laid over it; a model for several tasks has the loops of these changed as well.

        Args:
            changes: Keys and values of the top level.
            origin: What to call them in errors.
            place: More exactly where a value among them was written.

        Raises:
            ConfigError: If a key or value is not valid.
        """
        own = self.model_dump(mode="json", include=set(LoopConfig.model_fields) - {"mix"})
        loop = parse_config(Written(changes).over(Written(own)).values, LoopConfig, origin, place)
        mix = {task: each.changed(changes, origin, place) for task, each in self.mix.items()}
        return loop.model_copy(update={"mix": mix})

    @property
    def recording(self) -> RecordConfig:
        """What the scripted operator records."""
        return self._of_stage(self.record, RecordConfig)

    @property
    def ingestion(self) -> IngestionConfig:
        """Which logs become demonstrations."""
        return self._of_stage(self.ingest, IngestionConfig)

    @property
    def correction(self) -> CorrectConfig:
        """How many rollouts that failed an operator finishes: the one that records, unless another is asked for."""
        temperament = self.correct.temperament or self.record.temperament
        return self._of_stage(self.correct, CorrectConfig, temperament=temperament)

    @property
    def evaluation(self) -> EvaluateConfig:
        """The final measurement."""
        return self._of_stage(self.evaluate, EvaluateConfig)

    def evaluation_under(self, shift: Shift) -> EvaluateConfig:
        """The same measurement, from the same initial-state seeds, under a shift."""
        return self._of_stage(self.evaluate, EvaluateConfig, shift=shift)

    def _of_stage(self, section: StrictConfig, model: type[ConfigT], **changes: Any) -> ConfigT:
        """A stage's configuration: what its section says, and the scene that all of them share."""
        own = dict(section)
        scene = {"task": self.task, "randomness": own.get("randomness") or self.randomness}
        known = {key: value for key, value in {**own, **scene}.items() if key in model.model_fields}
        return model(**{**known, **changes})

    def training(self, condition: Condition, seed: int, *, goes_on: bool = False) -> TrainConfig:
        """How a condition trains the model of a seed, from nothing or going on from the model before."""
        config = self.policies[condition.policy]
        training = config.training
        if condition.state_noise:
            training = training.model_copy(update={"state_noise": self.state_noise})
        if goes_on and (steps := condition.retraining_steps):
            warmup_steps = min(training.warmup_steps, steps // 10)
            training = training.model_copy(update={"steps": steps, "warmup_steps": warmup_steps})
        return config.model_copy(update={"training": training, "seed": config.seed + seed})

    def final_training(self, condition: Condition, seed: int) -> TrainConfig:
        """The same for the model that is evaluated, which may be one for several tasks."""
        policy = condition.joint_policy or condition.policy
        return self.training(condition.model_copy(update={"policy": policy}), seed)

    def turns(self, condition: Condition) -> int:
        """How often a condition collects, selects and trains again."""
        return (condition.rounds or self.rounds) if condition.collect else 0

    def collection(self, seed: int, round_index: int) -> CollectConfig:
        """Rollouts of a turn; every model and turn starts from initial states of its own."""
        turn = seed * MOST_ROUNDS + round_index - 1
        return self._of_stage(self.collect, CollectConfig, first=self.collect.first + turn * self.collect.max_episodes)

    def largest_seed(self, condition: Condition) -> int:
        """The last seed whose models find initial states to collect from; below 0 if there is none."""
        turns = (len(SEED_RANGES[Purpose.COLLECTION]) - self.collect.first) // self.collect.max_episodes
        return (turns - self.turns(condition)) // MOST_ROUNDS
