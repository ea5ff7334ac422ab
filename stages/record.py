"""Operator logs, recorded from the scripted operator, who stands in for a human."""

from __future__ import annotations

from pydantic import Field

from juicer.artifacts.manifest import FINDING
from juicer.config import Seed, StrictConfig
from juicer.demonstration.recording import minutes_of, record_demonstrations
from juicer.expert.operator import DEVICE, scripted_operators
from juicer.expert.steady import Steady
from juicer.expert.temperament import Temperament
from juicer.seed_ranges import Purpose, claim
from juicer.tasks.specification import Randomness
from juicer.tasks.task_name import TaskName
from stages.runtime.context import StageContext
from stages.runtime.stage import stage


class RecordSection(StrictConfig):
    """What the operator is asked for, whatever the task."""

    randomness: Randomness | None = Field(
        default=None, description="level of the initial states; that of the top level if empty"
    )
    demonstrations: int = Field(default=50, gt=0, le=1_000_000, description="successful recordings wanted")
    max_recordings: int = Field(
        default=200, gt=0, le=1_000_000, description="recordings after which the operator gives up"
    )
    first: int = Field(
        default=0, ge=0, lt=1_000_000, description="position of the first initial state among those for demonstrations"
    )
    seed: Seed = Field(default=0, description="root of the operator's habits")
    temperament: Temperament = Field(default=Steady(), description="how unlike a machine the operator is")


class RecordConfig(RecordSection):
    """What the operator is asked for."""

    task: TaskName = Field(description="assembly task")
    randomness: Randomness = Field(description="level of the initial states")


@stage(
    kind="logs",
    libraries=("mujoco", "numpy"),
    noun="logs",
    counts="logs",
    headline=("successes", "logs"),
)
def record(context: StageContext, *, config: RecordConfig) -> None:
    """Let the scripted operator assemble, and record it as a human's recording tool would."""
    seeds = claim(Purpose.DEMONSTRATIONS, config.first, config.max_recordings)
    sitting = record_demonstrations(
        context.draft.path,
        config.task,
        config.randomness,
        seeds,
        scripted_operators(config.seed, config.temperament),
        successes=config.demonstrations,
        workers=context.machine.workers,
        progress=context.progress,
    )
    context.draft.summary |= {
        "logs": sitting.recordings,
        "successes": sitting.successes,
        "success_rate": sitting.successes / sitting.recordings,
        "device": DEVICE,
        "steps": sitting.steps,
        "idle_steps": sitting.idle_steps,
        "operator_minutes": minutes_of(sitting.steps),
    }
    if not sitting.successes:
        # Hours of recordings that failed are not made again: what lacks demonstrations is what ingests them.
        failed = f"the scripted operator failed in all of {sitting.recordings} recordings"
        context.draft.summary[FINDING] = failed
