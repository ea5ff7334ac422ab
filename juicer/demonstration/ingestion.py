"""Operator logs become demonstrations, or are rejected one by one with a reason."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from juicer.config import StrictConfig
from juicer.demonstration.claims import ClaimChecker
from juicer.demonstration.header import LogHeader
from juicer.demonstration.log import (
    FINAL_PREFIX,
    LOG,
    PARENT_ACTION,
    LogFile,
    OperatorLog,
    check_parent_actions,
)
from juicer.episode import (
    CONTINUOUS_KEY,
    DEMONSTRATION,
    RECORDED_STEP_KEY,
    SIMULATOR,
    STATE_KEY,
    Episode,
    EpisodeRecord,
    Outcome,
    Source,
)
from juicer.errors import ConfigError, InvalidAction, RejectedLog, did_you_mean
from juicer.geometry import rot6d_to_matrix
from juicer.gripper import gripper_commands
from juicer.progress import Progress, silent_progress
from juicer.seed_ranges import Purpose, check_seeds
from juicer.tasks.registry import get_task
from juicer.tasks.specification import parse_randomness
from juicer.tasks.task_name import TaskName
from juicer.text import printable


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
class Demonstration:
    """A log that became a demonstration.

    Attributes:
        source: Name of the log.
        num_steps: Steps of the log.
        kept: Which of them became the episode's steps, in order ``(T,)``.
        episode: The demonstration.
    """

    source: str
    num_steps: int
    kept: NDArray[np.intp]
    episode: Episode


@dataclass(frozen=True)
class UnusableLog:
    """A log that became no demonstration.

    Attributes:
        source: Name of the log.
        reason: Why, as one sentence.
        num_steps: Steps that an operator spent on it; 0 if it cannot be read, or is a copy of another one.
    """

    source: str
    reason: str
    num_steps: int = 0


class _Copy(RejectedLog):
    """A recording that was there already."""


def ingest(
    paths: Sequence[Path], config: IngestionConfig, progress: Progress = silent_progress
) -> Iterator[Demonstration | UnusableLog]:
    """Read logs one at a time; each yields a demonstration or the reason why it is none."""
    ingestion = Ingestion(config)
    kept = 0
    for done, path in enumerate(paths, start=1):
        result = ingestion.judge(path, printable(path.name))
        kept += isinstance(result, Demonstration)
        progress(done, len(paths), kept=kept, rejected=done - kept)
        yield result


class Ingestion:
    """Judges the logs of one task, one after the other."""

    def __init__(self, config: IngestionConfig) -> None:
        """Prepare the task's scene.

        Raises:
            ConfigError: If there is no such task.
        """
        self._config = config
        self._task = get_task(config.task)
        self._claims = ClaimChecker(config.task)
        self._sources: dict[str, str] = {}

    def ingest(self, path: Path, source: str) -> Demonstration:
        """Read a log, check it and turn it into a demonstration; ``source`` is its name.

        What is wrong with its header or its shapes is said before its arrays are unpacked.

        Raises:
            RejectedLog: With the reason, if the log is no good demonstration of the task.
        """
        return self._ingest_file(LogFile(path), source)

    def judge(self, path: Path, source: str) -> Demonstration | UnusableLog:
        """The same, with a log that is no good as a result."""
        num_steps = 0
        try:
            file = LogFile(path)
            num_steps = file.num_steps
            return self._ingest_file(file, source)
        except RejectedLog as error:
            return UnusableLog(source, str(error), 0 if isinstance(error, _Copy) else num_steps)

    def ingest_log(self, log: OperatorLog, source: str = "") -> Demonstration:
        """The same for a log that is in memory.

        Raises:
            RejectedLog: With the reason, if the log is no good demonstration of the task.
        """
        self._check_facts(log)
        self._check_shapes(log, {name: values.shape for name, values in log.arrays.items()})
        return self._demonstration(log, source)

    def _ingest_file(self, file: LogFile, source: str) -> Demonstration:
        self._check_facts(file.header)
        self._check_shapes(file.header, file.shapes)
        return self._demonstration(file.read(), source)

    def _demonstration(self, log: OperatorLog, source: str) -> Demonstration:
        config = self._config
        _check_finite(log)
        _check_rewards(log)
        _check_actions(log)
        _check_timestamps(log.timestamp_s, config.max_gap_s)
        keep = steps_to_keep(log.steps["action"], log.idle, config.kept_after_toggle, log.parent_actions)
        num_kept = np.count_nonzero(keep)
        # What is left to be done of a rollout may take a moment only.
        needed = config.min_steps if log.parent is None else 1
        if num_kept < needed:
            raise RejectedLog(f"only {num_kept} of its steps are not idle, at least {needed} are needed")
        recorded = _recorded(log, source)
        identity = recorded.record.episode_id
        if identity in self._sources:
            raise _Copy(f"it is the same recording as '{self._sources[identity]}'")
        self._claims.check(log)
        self._sources[identity] = source
        return Demonstration(source, len(log), np.flatnonzero(keep), without_idle_steps(recorded, keep))

    def _check_facts(self, header: LogHeader) -> None:
        if header.task != self._task.name:
            raise RejectedLog(f"it shows task '{header.task}', but '{self._task.name}' is being ingested")
        if not header.success:
            raise RejectedLog("the operator marked it as failed")
        if header.outcome != Outcome.SUCCESS:
            raise RejectedLog(
                f"the operator marked it as a success, but the environment ended it as '{header.outcome}'"
            )
        try:
            parse_randomness(header.randomness)
            check_seeds(Purpose.DEMONSTRATIONS if header.parent is None else Purpose.COLLECTION, [header.seed])
        except ConfigError as error:
            raise RejectedLog(str(error)) from None
        num_pairs = len(self._task.pairs)
        if header.parts_assembled != num_pairs:
            raise RejectedLog(
                f"it counts {header.parts_assembled} assembled pairs; a success has all {num_pairs} of the task's"
            )
        for name in header.milestones:
            if name not in self._task.milestones:
                raise RejectedLog(f"unknown milestone '{name}'{did_you_mean(name, self._task.milestones)}")

    def _check_shapes(self, header: LogHeader, shapes: Mapping[str, tuple[int, ...]]) -> None:
        length = shapes["action"][0]
        if header.parent is not None:
            check_parent_actions(header, shapes[PARENT_ACTION])
        if length == 0:
            raise RejectedLog("it holds no steps")
        sizes = {"part_poses": (7 * len(self._task.parts),), STATE_KEY: (self._claims.state_size,)}
        for name in LOG.names():
            shape = shapes[name]
            if shape[0] != length:
                raise RejectedLog(f"array '{name}' has {shape[0]} steps where 'action' has {length}")
            expected = (length, *sizes.get(name, LOG[name].shape))
            if shape != expected and name == STATE_KEY:
                raise RejectedLog(
                    f"its simulator states have the shape {printable(shape[1:])} where those of the task's scene have "
                    f"{self._claims.state_size} entries; it was recorded in another scene, record it again in this one"
                )
            if shape != expected:
                raise RejectedLog(f"array '{name}' must have the shape {expected}, got {printable(shape)}")
        for name in LOG.ends:
            if shapes[FINAL_PREFIX + name] != shapes[name][1:]:
                raise RejectedLog(f"the final '{name}' is not finite or unlike those of the steps")


def steps_to_keep(
    actions: NDArray[np.generic],
    idle: NDArray[np.bool_],
    kept_after_toggle: int,
    parent_actions: NDArray[np.generic] | None = None,
) -> NDArray[np.bool_]:
    """Which steps stay: those in which the operator acted, and those that follow a gripper toggle.

    Args:
        actions: Actions ``(T, 10)``.
        idle: Whether the operator was idle ``(T,)``.
        kept_after_toggle: Steps after a toggle that stay in any case, for the fingers take time to move.
        parent_actions: Actions since the reset before them ``(P, 10)``; none if left out. At the reset the gripper is
            open.
    """
    before = 0 if parent_actions is None else len(parent_actions)
    told = actions if parent_actions is None else np.concatenate([parent_actions, actions])
    keep = np.concatenate([np.zeros(before, np.bool_), ~idle])
    toggles = np.flatnonzero(np.diff(gripper_commands(told), prepend=-1.0))
    for step in toggles:
        keep[step : step + 1 + kept_after_toggle] = True
    return keep[before:]


def _check_finite(log: OperatorLog) -> None:
    for name, values in {**log.steps, "timestamp_s": log.timestamp_s}.items():
        numbers = np.asarray(values, dtype=np.float64).reshape(len(log), -1)
        broken = np.flatnonzero(~np.isfinite(numbers).all(axis=1))
        if broken.size:
            raise RejectedLog(f"array '{name}' holds NaN or infinite values, first at step {broken[0]}")
    if not np.isfinite(log.parent_actions).all():
        raise RejectedLog(f"array '{PARENT_ACTION}' holds NaN or infinite values")
    for name in LOG.ends:
        if not np.isfinite(np.asarray(log.final[name], dtype=np.float64)).all():
            raise RejectedLog(f"the final '{name}' is not finite or unlike those of the steps")


def _check_rewards(log: OperatorLog) -> None:
    """A step earns as many points as pairs it assembles."""
    reward = np.asarray(log.steps["reward"], dtype=np.float64)
    odd = np.flatnonzero((reward < 0) | (reward != np.rint(reward)) | (reward > log.parts_assembled))
    if odd.size:
        raise RejectedLog(f"the reward of step {odd[0]} must be a number of pairs, got {reward[odd[0]]:g}")
    earned, counted = reward.sum(), log.parts_assembled
    # Some pairs may have been assembled where a correction begins, but not all.
    if earned != counted and (log.parent is None or not 0 < earned < counted):
        raise RejectedLog(f"its rewards add up to {earned:g}, but it counts {counted} assembled pairs")
    for name, step in log.milestones.items():
        if step > len(log):
            raise RejectedLog(f"it claims milestone '{name}' after {step} steps, but holds {len(log)}")


def _check_actions(log: OperatorLog) -> None:
    action = np.asarray(log.steps["action"], dtype=np.float64)
    outside = np.flatnonzero((np.abs(action) > 1.0 + 1e-6).any(axis=1))
    if outside.size:
        raise RejectedLog(f"the action at step {outside[0]} leaves the range [-1, 1]")
    try:
        rot6d_to_matrix(action[:, 3:9])
    except InvalidAction as error:
        raise RejectedLog(f"an action does not encode a pose: {error}") from None


def _check_timestamps(timestamp_s: NDArray[np.float64], max_gap_s: float) -> None:
    gaps = np.diff(timestamp_s)
    if gaps.size and gaps.min() <= 0:
        raise RejectedLog(f"timestamps do not increase after step {int(np.argmin(gaps))}")
    if gaps.size and gaps.max() > max_gap_s:
        raise RejectedLog(f"steps are missing: {gaps.max():.2f} s pass after step {int(np.argmax(gaps))}")


def _recorded(log: OperatorLog, source: str) -> Episode:
    """The whole recording, idle steps included: what its id is a digest of."""
    source_kind = Source.TELEOP if log.parent is None else Source.CORRECTION
    shared = {entry.name for entry in fields(LogHeader)} & {entry.name for entry in fields(EpisodeRecord)}
    facts = {name: getattr(log, name) for name in shared} | {"outcome": Outcome.SUCCESS, "log": source or None}
    return Episode(
        record=EpisodeRecord(source=source_kind, **facts),
        steps={spec.name: np.asarray(log.steps[spec.name], dtype=spec.dtype) for spec in SIMULATOR},
        final={name: np.asarray(log.final[name], dtype=SIMULATOR[name].dtype) for name in SIMULATOR.ends},
    )


def without_idle_steps(recorded: Episode, keep: NDArray[np.bool_]) -> Episode:
    """A recording as an episode of the steps to keep; its id remains that of the recording.

    Args:
        recorded: Every step from the first to the end.
        keep: Which of them stay ``(T,)``, see :func:`steps_to_keep`.
    """
    kept_before: NDArray[np.intp] = np.cumsum(keep) - keep
    last = int(np.count_nonzero(keep)) - 1
    steps = {name: values[keep] for name, values in recorded.steps.items()}
    # A part may settle while the operator watches: what a dropped step earned goes to the last one kept before it.
    earner = np.clip(np.cumsum(keep) - 1, 0, last)
    steps["reward"] = np.bincount(earner, weights=recorded.steps["reward"], minlength=last + 1).astype(np.float32)
    steps[RECORDED_STEP_KEY] = np.flatnonzero(keep).astype(np.int32)
    steps[CONTINUOUS_KEY] = np.diff(steps[RECORDED_STEP_KEY], append=len(recorded)) == 1
    milestones = {
        name: min(int(kept_before[min(step, len(recorded) - 1)]), last)
        for name, step in recorded.record.milestones.items()
    }
    return Episode(replace(recorded.record, milestones=milestones), steps, recorded.final, DEMONSTRATION)
