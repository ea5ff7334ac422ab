"""An operator takes over where a policy has got stuck, and finishes the task: interactive imitation (DAgger)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from pydantic import Field

from juicer.config import StrictConfig
from juicer.demonstration.ingestion import steps_to_keep, without_idle_steps
from juicer.demonstration.operator import OperatorFactory
from juicer.episode import DemonstrationReader, Episode, EpisodeRecord, Outcome, Source
from juicer.progress import Progress, silent_progress
from juicer.sim.env import AssemblyEnv
from juicer.sim.pool import EnvironmentPool
from juicer.sim.recorder import EpisodeRecorder

KEPT_AFTER_TOGGLE = 12
"""Steps after a toggle of the gripper that stay even if the operator was idle, as in demonstrations."""
_NO_STEP_LIMIT = 10**9


class CorrectionConfig(StrictConfig):
    """When an operator takes over, and how often."""

    corrections: int = Field(default=10, gt=0, le=1_000_000, description="successful corrections wanted")
    max_attempts_per_correction: int = Field(
        default=3, gt=0, le=1000, description="attempts after which the operator settles for fewer"
    )
    patience_steps: int = Field(
        default=60, ge=0, le=100_000, description="steps without another milestone until the operator takes over"
    )
    lead_steps: int = Field(
        default=20, gt=0, le=100_000, description="steps before the failure at which the operator does so at the latest"
    )
    max_steps: int | None = Field(
        default=None,
        gt=0,
        le=1_000_000,
        description="steps after which the operator gives up; the task's limit if empty",
    )


@dataclass(frozen=True)
class Correction:
    """An operator's attempt to finish a failed rollout.

    Attributes:
        episode: What the operator did, idle steps left out; its outcome says whether it helped.
        human_steps: Control steps that it took, idle ones too.
        milestone: The last one that the policy had reached, empty if none.
    """

    episode: Episode
    human_steps: int
    milestone: str


def correct(
    rollouts: DemonstrationReader,
    operators: OperatorFactory,
    config: CorrectionConfig,
    *,
    num_workers: int | None = None,
    progress: Progress = silent_progress,
) -> Iterator[Correction]:
    """Let operators finish failed rollouts, in their order, and yield every attempt until enough succeeded.

    Args:
        rollouts: Episodes of a policy in our simulator; those that succeeded are passed over.
        operators: Make the operator of an attempt from its task and the rollout's seed.
        config: When an operator takes over, and how often.
        num_workers: Threads, each with an environment of its own; one a processor if None.
        progress: Called after every attempt: corrections so far of those wanted.

    Yields:
        Every attempt, whether it succeeded or not; nothing if no rollout failed.

    Raises:
        ConfigError: If the operator has not learned the task.
    """
    failed = [number for number, record in enumerate(rollouts.records) if _can_be_corrected(record)]
    failed = failed[: config.corrections * config.max_attempts_per_correction]
    if not failed:
        return

    def work(env: AssemblyEnv, number: int) -> Correction:
        return take_over(env, rollouts.read(number), operators, config)

    achieved = 0
    with EnvironmentPool(rollouts.records[0].task, num_workers, max_steps=_NO_STEP_LIMIT) as pool:
        for attempts, correction in enumerate(pool.map(work, failed), start=1):
            achieved += correction.episode.record.outcome is Outcome.SUCCESS
            progress(achieved, config.corrections, attempts=attempts)
            yield correction
            if achieved == config.corrections:
                return


def _can_be_corrected(record: EpisodeRecord) -> bool:
    return record.outcome in (Outcome.TIMEOUT, Outcome.PART_LOST)


def takeover_step(rollout: Episode, config: CorrectionConfig) -> int:
    """Step at which an onlooker loses patience: some time after the last milestone, and before all is lost."""
    reached = max(rollout.record.milestones.values(), default=0)
    return max(min(reached + config.patience_steps, len(rollout) - config.lead_steps), 0)


def take_over(env: AssemblyEnv, rollout: Episode, operators: OperatorFactory, config: CorrectionConfig) -> Correction:
    """One attempt to finish a rollout.

    Args:
        env: Environment of the rollout's task without a step limit; its state is replaced.
        rollout: An episode that failed.
        operators: Make the operator.
        config: When the operator takes over, and gives up.
    """
    start, origin = takeover_step(rollout, config), rollout.record
    env.set_state(rollout.state(start))
    operator, recorder = operators(env.task, origin.seed), EpisodeRecorder(env)
    limit = config.max_steps or env.task.max_steps
    idle: list[bool] = []
    while not recorder.done and len(recorder) < limit:
        step = operator.act(recorder.observation)
        recorder.step(step.action)
        idle.append(step.idle)
    info = recorder.info
    record = EpisodeRecord(
        source=Source.CORRECTION,
        task=origin.task,
        randomness=origin.randomness,
        seed=origin.seed,
        outcome=Outcome(info["outcome"] or Outcome.TIMEOUT),
        parts_assembled=int(info["parts_assembled"]),
        milestones={name: step - start for name, step in info["milestones"].items() if step >= start},
        parent=origin.episode_id,
        parent_step=start,
        device=operator.device,
    )
    recorded = recorder.episode(record)
    keep = steps_to_keep(recorded.steps["action"], np.array(idle), KEPT_AFTER_TOGGLE, rollout.steps["action"][:start])
    if not keep.any():
        keep[-1] = True  # who never acted has failed, and an episode has a step
    before = {name: step for name, step in origin.milestones.items() if step <= start}
    return Correction(
        episode=without_idle_steps(recorded, keep),
        human_steps=len(idle),
        milestone=max(before, key=before.__getitem__, default=""),
    )
