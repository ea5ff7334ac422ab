"""Rollouts of a trained policy, from its checkpoint: where they start, how long they take, and who computes them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from pydantic import Field

from juicer.config import Seed, StrictConfig
from juicer.episode import Episode
from juicer.progress import Progress, silent_progress
from juicer.rollout import rollout
from juicer.shifts import Shift
from juicer.tasks.specification import Randomness
from juicer.tasks.task_name import TaskName

MOST_SAMPLES = 10_000


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
    inference_steps: int | None = Field(
        default=None,
        gt=0,
        le=1000,
        description="steps in which a chunk is sampled; as many as the policy says if empty",
    )
    samples: int = Field(
        default=1,
        gt=0,
        le=MOST_SAMPLES,
        description="chunks that are drawn at each prediction; of several, the one where they are densest is executed",
    )


def roll_out(
    checkpoint: Path,
    policy_id: str,
    config: RolloutConfig,
    seeds: Iterable[int],
    *,
    num_envs: int,
    num_workers: int | None = None,
    device: str = "cpu",
    stop_after_successes: int | None = None,
    shift: Shift | None = None,
    progress: Progress = silent_progress,
) -> Iterator[Episode]:
    """Episodes of a checkpoint's policy; see :func:`juicer.rollout.rollout`.

    Args:
        checkpoint: Folder of the checkpoint.
        policy_id: Its id, recorded in every episode.
        config: Task, randomness, limit of steps, noise and sampling; where it starts is said by ``seeds``.
        seeds: Initial-state seeds.
        num_envs: Environments that run side by side.
        num_workers: Threads that step them.
        device: Torch device that computes the actions.
        stop_after_successes: Yield nothing after this many successes.
        shift: In what the scenes differ from training; nothing if None.
        progress: Called after every turn of the environments.

    Raises:
        InvalidCheckpoint: If the checkpoint is damaged, or not of the task.
        ConfigError: If there is no such device, the policy cannot sample in so many steps, or it cannot notice the
            shift.
    """
    from juicer.policy.checkpoint import load_policy  # torch takes seconds to import

    return rollout(
        load_policy(checkpoint, config.task, config.max_steps, device, config.inference_steps, config.samples),
        config.task,
        config.randomness,
        seeds,
        num_envs=num_envs,
        max_steps=config.max_steps,
        policy_id=policy_id,
        root_seed=config.seed,
        stop_after_successes=stop_after_successes,
        num_workers=num_workers,
        shift=shift,
        progress=progress,
    )
