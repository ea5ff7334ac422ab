"""Operator logs become demonstrations, or are rejected one by one with a reason."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from juicer.config import StrictConfig
from juicer.episode import (
    ACTION_SIZE,
    FINAL_KEYS,
    PROPRIOCEPTION_SIZE,
    STATE_KEY,
    STEP_DTYPES,
    Episode,
    EpisodeRecord,
    Outcome,
    Source,
)
from juicer.errors import ConfigError, InvalidAction, RejectedLog
from juicer.geometry import rot6d_to_matrix
from juicer.gripper import gripper_commands
from juicer.progress import Progress, silent_progress
from juicer.seed_ranges import Purpose, check_seeds
from juicer.sim.env import AssemblyEnv
from juicer.tasks.registry import get_task
from juicer.tasks.specification import parse_randomness
from juicer.tasks.task_name import TaskName
from juicer.teleoperation.log import OperatorLog, read_log


class IngestionSection(StrictConfig):
    """What makes a log a demonstration, whatever the task."""

    kept_after_toggle: int = Field(
        default=12, ge=0, le=10_000, description="steps kept after a gripper toggle even if the operator was idle"
    )
    min_steps: int = Field(
        default=50, gt=0, le=1_000_000, description="a shorter demonstration is a slip of the recording tool"
    )
    max_gap_s: float = Field(default=0.5, gt=0, le=3600, description="a longer gap between two steps means lost steps")


class IngestionConfig(IngestionSection):
    """What makes a log a demonstration of a task."""

    task: TaskName = Field(description="assembly task that the logs must show")


@dataclass(frozen=True)
class Rejection:
    """A log that became no demonstration.

    Attributes:
        source: Name of the log.
        reason: Why, as one sentence.
    """

    source: str
    reason: str


def ingest(
    paths: Sequence[Path], config: IngestionConfig, progress: Progress = silent_progress
) -> Iterator[Episode | Rejection]:
    """Read logs one at a time; each yields a demonstration or the reason why it is none."""
    kept = 0
    for done, path in enumerate(paths, start=1):
        try:
            result: Episode | Rejection = ingest_log(read_log(path), config)
            kept += 1
        except RejectedLog as error:
            result = Rejection(source=path.name, reason=str(error))
        progress(done, len(paths), kept=kept, rejected=done - kept)
        yield result


def ingest_log(log: OperatorLog, config: IngestionConfig) -> Episode:
    """Check a log and turn it into a demonstration without the operator's idle steps.

    Raises:
        RejectedLog: With the reason, if the log is no good demonstration of the task.
        ConfigError: If the config names an unknown task.
    """
    if log.task != config.task:
        raise RejectedLog(f"it shows task '{log.task}', but '{config.task}' is being ingested")
    if not log.success:
        raise RejectedLog("the operator marked it as failed")
    if log.outcome != Outcome.SUCCESS:
        raise RejectedLog(f"the operator marked it as a success, but the environment ended it as '{log.outcome}'")
    _check_facts(log)
    _check_arrays(log)
    _check_actions(log)
    _check_timestamps(log.timestamp_s, config.max_gap_s)
    keep = steps_to_keep(log.steps["action"], log.idle, config.kept_after_toggle)
    num_kept = np.count_nonzero(keep)
    if num_kept < config.min_steps:
        raise RejectedLog(f"only {num_kept} of its steps are not idle, at least {config.min_steps} are needed")
    return _episode(log, keep)


def steps_to_keep(actions: NDArray[np.generic], idle: NDArray[np.bool_], kept_after_toggle: int) -> NDArray[np.bool_]:
    """Which steps stay: those in which the operator acted, and those that follow a gripper toggle.

    Args:
        actions: Actions ``(T, 10)``; the gripper starts open.
        idle: Whether the operator was idle ``(T,)``.
        kept_after_toggle: Steps after a toggle that stay in any case, for the fingers take time to move.
    """
    keep = ~idle
    toggles = np.flatnonzero(np.diff(gripper_commands(actions), prepend=-1.0))
    for step in toggles:
        keep[step : step + 1 + kept_after_toggle] = True
    return keep


def _check_facts(log: OperatorLog) -> None:
    try:
        parse_randomness(log.randomness)
        check_seeds(Purpose.DEMONSTRATIONS, [log.seed])
    except ConfigError as error:
        raise RejectedLog(str(error)) from None
    num_pairs = len(get_task(log.task).pairs)
    if not 0 <= log.parts_assembled <= num_pairs:
        raise RejectedLog(f"it counts {log.parts_assembled} assembled pairs of the task's {num_pairs}")


@cache
def _sim_state_size(task: str) -> int:
    return len(AssemblyEnv(task).get_state())


def _check_arrays(log: OperatorLog) -> None:
    num_parts = len(get_task(log.task).parts)
    length = len(log)
    shapes: dict[str, tuple[int, ...]] = {
        "action": (length, ACTION_SIZE),
        "proprioception": (length, PROPRIOCEPTION_SIZE),
        "part_poses": (length, 7 * num_parts),
        "reward": (length,),
        "timestamp_s": (length,),
        "idle": (length,),
    }
    if length == 0:
        raise RejectedLog("it holds no steps")
    for name, values in {**log.steps, "timestamp_s": log.timestamp_s, "idle": log.idle}.items():
        if len(values) != length:
            raise RejectedLog(f"array '{name}' has {len(values)} steps where 'action' has {length}")
        if values.shape != shapes.get(name, values.shape):
            raise RejectedLog(f"array '{name}' must have the shape {shapes[name]}, got {values.shape}")
        broken = np.flatnonzero(~np.isfinite(np.asarray(values, dtype=np.float64)).reshape(length, -1).all(axis=1))
        if broken.size:
            raise RejectedLog(f"array '{name}' holds NaN or infinite values, first at step {broken[0]}")
    size = _sim_state_size(log.task)
    if log.steps[STATE_KEY].shape != (length, size):
        raise RejectedLog(
            f"its simulator states have the shape {log.steps[STATE_KEY].shape[1:]} where those of the task's scene "
            f"have {size} entries; it was recorded in another scene, record it again in this one"
        )
    for name in FINAL_KEYS:
        if log.final[name].shape != log.steps[name].shape[1:] or not np.isfinite(log.final[name]).all():
            raise RejectedLog(f"the final '{name}' is not finite or unlike those of the steps")


def _check_actions(log: OperatorLog) -> None:
    action = np.asarray(log.steps["action"], dtype=np.float64)
    outside = np.flatnonzero((np.abs(action) > 1.0 + 1e-6).any(axis=1))
    if outside.size:
        raise RejectedLog(f"the action at step {outside[0]} leaves the range [-1, 1]")
    try:
        rot6d_to_matrix(action[:, 3:9])
    except InvalidAction as error:
        raise RejectedLog(f"an action is no pose: {error}") from None


def _check_timestamps(timestamp_s: NDArray[np.float64], max_gap_s: float) -> None:
    gaps = np.diff(timestamp_s)
    if gaps.size and gaps.min() <= 0:
        raise RejectedLog(f"timestamps do not increase after step {int(np.argmin(gaps))}")
    if gaps.size and gaps.max() > max_gap_s:
        raise RejectedLog(f"steps are missing: {gaps.max():.2f} s pass after step {int(np.argmax(gaps))}")


def _episode(log: OperatorLog, keep: NDArray[np.bool_]) -> Episode:
    kept_before: NDArray[np.intp] = np.cumsum(keep) - keep
    last = int(np.count_nonzero(keep)) - 1
    steps = {name: np.asarray(values[keep], dtype=STEP_DTYPES[name]) for name, values in log.steps.items()}
    # A part may settle while the operator watches: what a dropped step earned goes to the last one kept before it.
    earner = np.clip(np.cumsum(keep) - 1, 0, last)
    steps["reward"] = np.bincount(earner, weights=log.steps["reward"], minlength=last + 1).astype(np.float32)
    record = EpisodeRecord(
        source=Source.TELEOP,
        task=log.task,
        randomness=log.randomness,
        seed=log.seed,
        outcome=Outcome.SUCCESS,
        parts_assembled=log.parts_assembled,
        milestones={
            name: min(int(kept_before[min(step, len(log) - 1)]), last) for name, step in log.milestones.items()
        },
        device=log.device,
    )
    return Episode(record=record, steps=steps, final={name: log.final[name] for name in FINAL_KEYS})
