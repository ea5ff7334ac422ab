"""Rollouts of a checkpoint's policy, as collection and evaluation both make them."""

from __future__ import annotations

from collections.abc import Iterator

from pydantic import Field

from juicer.artifacts.ref import ArtifactRef
from juicer.config import Seed, StrictConfig
from juicer.episode import Episode
from juicer.progress import Progress
from juicer.rollout import rollout
from juicer.seed_ranges import Purpose, claim
from juicer.tasks.specification import Randomness
from juicer.tasks.task_name import TaskName
from stages.runtime.context import StageContext


class RolloutSection(StrictConfig):
    """Where rollouts start and how long they may take, whatever the task."""

    randomness: Randomness | None = Field(
        default=None, description="level of the initial states; that of the top level if empty"
    )
    first: int = Field(
        default=0, ge=0, lt=1_000_000, description="position of the first initial state among those for the purpose"
    )
    max_steps: int | None = Field(
        default=None, gt=0, le=100_000, description="steps an episode; the task's own limit if empty"
    )
    seed: Seed = Field(default=0, description="root of the policy's noise")


class RolloutConfig(RolloutSection):
    """Where rollouts start and how long they may take."""

    task: TaskName = Field(description="assembly task")
    randomness: Randomness = Field(description="level of the initial states")


def roll_out(
    context: StageContext,
    checkpoint: ArtifactRef,
    config: RolloutConfig,
    purpose: Purpose,
    max_episodes: int,
    progress: Progress,
    stop_after_successes: int | None = None,
) -> Iterator[Episode]:
    """Episodes of a checkpoint's policy from initial states that belong to ``purpose``, in their order."""
    from juicer.policy.checkpoint import load_policy  # torch takes seconds to import

    folder, machine = context.store.open(checkpoint, "checkpoint"), context.machine
    return rollout(
        load_policy(folder, config.task, config.max_steps, machine.device),
        config.task,
        config.randomness,
        claim(purpose, config.first, max_episodes),
        num_envs=machine.num_envs,
        max_steps=config.max_steps,
        policy_id=checkpoint.id,
        root_seed=config.seed,
        stop_after_successes=stop_after_successes,
        num_workers=machine.workers,
        progress=progress,
    )
