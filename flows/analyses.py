"""What a configuration asks to know of trained policies beside their success rates, and the stage calls for it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field, field_validator

from flows.conditions import Name
from juicer.annotation.holding import hold
from juicer.annotation.versions import is_versions
from juicer.artifacts.ref import ArtifactRef
from juicer.config import StrictConfig
from juicer.policy_rollout import MOST_SAMPLES, RolloutConfig
from stages.annotate import annotate
from stages.evaluate import evaluate
from stages.modes import ModesConfig, modes
from stages.monitor import MonitorConfig, MonitorSection, monitor
from stages.runtime.session import Session
from stages.sampling import SamplingConfig, SamplingSection, sampling

if TYPE_CHECKING:
    from flows.loop_config import LoopConfig


class ChosenModels(StrictConfig):
    """Which of a study's models are analysed; of these, those that draw samples."""

    conditions: tuple[Name, ...] = Field(default=(), max_length=100, description="of which conditions; all if empty")
    every_seed: bool = Field(default=False, description="whether those of every seed are, and not of the first alone")

    def concerns(self, condition: str, *, is_first_seed: bool) -> bool:
        """Whether a model is analysed."""
        return (is_first_seed or self.every_seed) and (not self.conditions or condition in self.conditions)


class SamplingAnalysis(ChosenModels, SamplingSection):
    """Samples of an action shortly before an insertion, by the steps in which they are drawn (Fig. 4)."""

    kind: Literal["sampling"]


class ModesAnalysis(ChosenModels):
    """Acting on the densest of several samples (mode sampling by kernel density): success and cost."""

    kind: Literal["modes"]
    samples: tuple[Annotated[int, Field(gt=0, le=MOST_SAMPLES)], ...] = Field(
        default=(1, 16, 256, 5000), min_length=1, max_length=20, description="how many are drawn at each prediction"
    )
    episodes: int | None = Field(
        default=None, gt=0, le=1_000_000, description="episodes for each number; as many as are evaluated if empty"
    )
    predictions: int = Field(default=10, gt=0, le=10_000, description="predictions whose cost is measured")

    @field_validator("samples")
    @classmethod
    def _are_distinct(cls, values: tuple[int, ...]) -> tuple[int, ...]:
        if len(set(values)) < len(values):
            raise ValueError("each number may be there only once")
        return tuple(sorted(values))


class MonitorAnalysis(ChosenModels, MonitorSection):
    """Whether the spread of samples tells beforehand which rollouts fail."""

    kind: Literal["monitor"]


Analysis = SamplingAnalysis | ModesAnalysis | MonitorAnalysis
AnyAnalysis = Annotated[Analysis, Field(discriminator="kind")]


def annotations_of(session: Session, config: LoopConfig, demonstrations: ArtifactRef) -> ArtifactRef:
    """Critical states of a loop's demonstrations; what people say of them is what they had said when the run began."""
    labels = config.labels
    if labels is not None and is_versions(labels):
        if labels not in session.held:
            session.held.setdefault(labels, hold(labels, session.store.cache / "labels" / "used"))
        labels = session.held[labels]
    return annotate(session, episodes=demonstrations, labels=labels, config=config.annotate)


def analyse(
    session: Session,
    config: LoopConfig,
    checkpoint: ArtifactRef,
    analysis: Analysis,
    get_demonstrations: Callable[[], ArtifactRef],
) -> ArtifactRef:
    """Make an analysis of a model.

    Args:
        session: Session of the model's stages.
        config: The loop that it was trained in.
        checkpoint: The model.
        analysis: What is to be known.
        get_demonstrations: Makes or finds the demonstrations of the loop, for an analysis that needs them.
    """
    if isinstance(analysis, SamplingAnalysis):
        demonstrations = get_demonstrations()
        annotations = annotations_of(session, config, demonstrations)
        drawn = SamplingConfig.model_validate({**_section(analysis, SamplingSection), "task": config.task})
        return sampling(session, checkpoint=checkpoint, episodes=demonstrations, annotations=annotations, config=drawn)
    rollouts = config.evaluation.model_copy(update={"episodes": analysis.episodes or config.evaluation.episodes})
    if isinstance(analysis, MonitorAnalysis):
        where = {**_section(rollouts, RolloutConfig), "episodes": rollouts.episodes}
        watch = {**_section(analysis, MonitorSection), **where}
        return monitor(session, checkpoint=checkpoint, config=MonitorConfig.model_validate(watch))
    evaluations = tuple(
        evaluate(session, checkpoint=checkpoint, config=rollouts.model_copy(update={"samples": samples}))
        for samples in analysis.samples
    )
    cost = ModesConfig(task=config.task, predictions=analysis.predictions)
    return modes(session, checkpoint=checkpoint, evaluations=evaluations, config=cost)


def _section(config: StrictConfig, model: type[StrictConfig]) -> dict[str, object]:
    """The part of a configuration that another model has as well."""
    return {name: getattr(config, name) for name in model.model_fields}
