"""Operator logs, recorded from the scripted operator, who stands in for a human."""

from __future__ import annotations

from pydantic import Field

from juicer.config import StrictConfig
from juicer.tasks.specification import Randomness
from stages.stage import StageContext, stage


class RecordConfig(StrictConfig):
    """What the operator is asked for."""

    task: str = Field(default="one_leg", description="assembly task")
    randomness: Randomness = Field(default=Randomness.LOW, description="level of the initial states")
    demonstrations: int = Field(default=50, gt=0, description="successful recordings wanted")
    max_recordings: int = Field(default=200, gt=0, description="recordings after which the operator gives up")
    first: int = Field(
        default=0, ge=0, description="position of the first initial state among those for demonstrations"
    )
    seed: int = Field(default=0, ge=0, description="root of the operator's habits")


@stage(kind="logs", libraries=("mujoco", "numpy"))
def record(context: StageContext, *, config: RecordConfig) -> None:
    """Let the scripted operator assemble, and record it as a human's recording tool would."""
    raise NotImplementedError
