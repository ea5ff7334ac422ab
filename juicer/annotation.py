"""Critical states: the steps of a demonstration where precision decides success.

There is one for every pair of the task: the last step at which the second part is held and still clear of the
first, just before it comes within touching distance on the way to its assembled pose. From there the
demonstration's own actions carry a snippet through the difficult part.

Clearance decides rather than contact: a peg that is aligned well enters its hole without touching it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from juicer.config import StrictConfig
from juicer.episode import STATE_KEY, Episode, Outcome
from juicer.errors import InvalidLabels
from juicer.geometry import quat_to_matrix, relative_pose, rotation_angle
from juicer.gripper import gripper_commands, next_gripper_change
from juicer.labels import Label
from juicer.progress import Progress, silent_progress
from juicer.sim.clearance import clearance_m
from juicer.sim.env import AssemblyEnv
from juicer.sim.pool import EnvironmentPool
from juicer.storage.tables import Annotation
from juicer.tasks.registry import get_task

# In a clean insertion a held part turns, moves once it is released, and takes time up to the first value;
# at the second the proposal is worthless. A released part may lean: that is no fault.
_TURN_DEG = (8.0, 30.0)
_SETTLING_M = (0.015, 0.03)
_DURATION_STEPS = (60.0, 240.0)
_SETTLING_STEPS = 10


class AnnotationConfig(StrictConfig):
    """How critical states are proposed."""

    neighbourhood_m: float = Field(
        default=0.06, gt=0, description="distance from its assembled position within which a part arrives"
    )
    clearance_m: float = Field(default=0.006, gt=0, description="parts that are closer are about to touch")


class DemonstrationReader(Protocol):
    """Episodes by number, e.g. :class:`juicer.storage.episodes.EpisodeReader`."""

    def __len__(self) -> int:
        """Number of episodes."""
        ...

    def read(self, index: int) -> Episode:
        """The episode of a number."""
        ...


@dataclass(frozen=True)
class Proposal:
    """A critical state that the simulator's truth suggests.

    Attributes:
        step: Last step at which the part is held and clear of its mate.
        critical_state: Index of the pair it leads to.
        confidence: How cleanly the part was inserted after it, between zero and one.
    """

    step: int
    critical_state: int
    confidence: float


def annotate(
    demonstrations: DemonstrationReader,
    config: AnnotationConfig,
    labels: Iterable[Label] = (),
    *,
    num_workers: int | None = None,
    progress: Progress = silent_progress,
) -> Iterator[Annotation]:
    """Annotate every successful demonstration; a human's labels replace the proposals.

    Args:
        demonstrations: Episodes of one task.
        config: How to propose.
        labels: What a human said. For an episode and critical state they name, nothing is proposed.
        num_workers: Threads, each with an environment of its own; one a processor if None.
        progress: Told of every demonstration.

    Yields:
        Annotations in the order of episodes, then of critical states.

    Raises:
        InvalidLabels: If a label names an episode, step or critical state that is not there.
    """
    if len(demonstrations) == 0:
        return
    task = demonstrations.read(0).record.task
    by_episode: dict[int, list[Label]] = {}
    for label in labels:
        _check_label(label, demonstrations, get_task(task).num_critical_states)
        by_episode.setdefault(label.episode, []).append(label)

    def work(env: AssemblyEnv, index: int) -> list[Annotation]:
        return _annotate_one(env, index, demonstrations.read(index), config, by_episode.get(index, []))

    with EnvironmentPool(task, num_workers) as pool:
        for index, annotations in enumerate(pool.map(work, range(len(demonstrations)))):
            progress(index + 1, len(demonstrations))
            yield from annotations


def propose(env: AssemblyEnv, demonstration: Episode, config: AnnotationConfig) -> list[Proposal]:
    """One proposal for every pair whose assembly begins with a held part that is clear of its mate.

    Args:
        env: Environment of the demonstration's task; its state is replaced.
        demonstration: A successful episode.
        config: How to propose.
    """
    proposals = (_propose_pair(env, demonstration, pair, config) for pair in range(len(env.task.pairs)))
    return [proposal for proposal in proposals if proposal is not None]


def _annotate_one(
    env: AssemblyEnv, index: int, demonstration: Episode, config: AnnotationConfig, labels: list[Label]
) -> list[Annotation]:
    labelled = {label.critical_state for label in labels}
    rows = [Annotation(index, label.step, label.critical_state, "human", 1.0) for label in labels]
    if demonstration.record.outcome is Outcome.SUCCESS and len(labelled) < env.task.num_critical_states:
        rows += [
            Annotation(index, proposal.step, proposal.critical_state, "proposed", proposal.confidence)
            for proposal in propose(env, demonstration, config)
            if proposal.critical_state not in labelled
        ]
    return sorted(rows, key=lambda row: row.critical_state)


def _check_label(label: Label, demonstrations: DemonstrationReader, num_critical_states: int) -> None:
    if not 0 <= label.episode < len(demonstrations):
        raise InvalidLabels(
            f"{label.where}: there is no episode {label.episode}; episodes are numbered 0 to {len(demonstrations) - 1}"
        )
    length = len(demonstrations.read(label.episode))
    if not 0 <= label.step < length:
        raise InvalidLabels(f"{label.where}: episode {label.episode} has no step {label.step}; it has {length} steps")
    if not 0 <= label.critical_state < num_critical_states:
        raise InvalidLabels(
            f"{label.where}: there is no critical state {label.critical_state}; "
            f"the task has {num_critical_states}, numbered from 0"
        )


def _propose_pair(
    env: AssemblyEnv, demonstration: Episode, critical_state: int, config: AnnotationConfig
) -> Proposal | None:
    relative, distance = _relative_poses(env, demonstration, critical_state)
    away = np.flatnonzero(distance > config.neighbourhood_m)
    if len(away) == 0 or away[-1] + 1 >= len(demonstration):
        return None
    arrival = int(away[-1]) + 1
    change = next_gripper_change(demonstration.steps["action"], arrival)
    release = len(demonstration) - 1 if change is None else change
    step = _last_clear_step(env, demonstration, critical_state, range(arrival, release), config.clearance_m)
    if step is None:
        return None
    settled = min(release + _SETTLING_STEPS, len(relative) - 1)
    turned = rotation_angle(quat_to_matrix(relative[step, 3:]), quat_to_matrix(relative[release, 3:]))
    sunk = np.linalg.norm(relative[settled, :3] - relative[release, :3])
    confidence = (
        _fade(float(np.degrees(turned)), _TURN_DEG)
        * _fade(float(sunk), _SETTLING_M)
        * _fade(release - step, _DURATION_STEPS)
    )
    return Proposal(step, critical_state, confidence)


def _last_clear_step(
    env: AssemblyEnv, demonstration: Episode, critical_state: int, steps: range, limit_m: float
) -> int | None:
    """Last of the steps at which the second part is held and farther than the limit from the first."""
    pair = env.task.pairs[critical_state]
    first, second = env.task.parts[pair.first].name, env.task.parts[pair.second].name
    closed = gripper_commands(demonstration.steps["action"]) > 0
    for step in reversed(steps):
        env.set_state(np.asarray(demonstration.steps[STATE_KEY][step], dtype=np.float64))
        if clearance_m(env.model, env.data, first, second, limit_m) >= limit_m:
            grasped = any({"gripper", second} == set(names) for names in env.contact_pairs())
            return step if closed[step] and grasped else None
    return None


def _relative_poses(
    env: AssemblyEnv, demonstration: Episode, critical_state: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Poses ``(T + 1, 7)`` of the second part in the first's frame, and distances ``(T + 1,)`` from the target."""
    pair = env.task.pairs[critical_state]
    poses = np.concatenate([demonstration.steps["part_poses"], demonstration.final["part_poses"][None]])
    poses = np.asarray(poses, dtype=np.float64).reshape(len(poses), -1, 7)
    relative = np.asarray(relative_pose(poses[:, pair.first], poses[:, pair.second]), dtype=np.float64)
    targets = np.asarray(pair.targets)[:, :3]
    # Of several targets, the one that the demonstration ended in.
    target = targets[np.argmin(np.linalg.norm(targets - relative[-1, :3], axis=1))]
    return relative, np.linalg.norm(relative[:, :3] - target, axis=1)


def _fade(value: float, bounds: tuple[float, float]) -> float:
    """One up to the first bound, falling linearly to zero at the second."""
    return float(np.clip((bounds[1] - value) / (bounds[1] - bounds[0]), 0.0, 1.0))
