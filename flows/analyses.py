"""What a configuration asks to know of trained policies beside their success rates."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, field_validator

from flows.conditions import Name
from juicer.config import StrictConfig
from juicer.policy_rollout import MOST_SAMPLES
from stages.monitor import MonitorSection
from stages.sampling import SamplingSection


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
