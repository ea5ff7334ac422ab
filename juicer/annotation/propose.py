"""Critical states: the steps of a demonstration where precision decides success, found in the simulator's truth.

An insertion's is the last step at which the second part is held and still clear of the first, just before it comes
within touching distance on the way to its assembled pose; clearance decides rather than contact, as a peg that is
aligned well enters its hole without touching it. A grasp's is the last step at which the open gripper is still a little
away from where it closes; that of the placing of the first part is the last at which it is held and still a little away
from where it is let go. From there the demonstration's own actions carry a snippet through the difficult part.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from juicer.config import StrictConfig
from juicer.episode import Episode
from juicer.geometry import quat_to_matrix, relative_pose, rotation_angle
from juicer.gripper import gripper_commands, next_gripper_change
from juicer.sim.clearance import clearance_m
from juicer.sim.env import AssemblyEnv
from juicer.sim.milestones import BaseProgress
from juicer.tasks.specification import AssemblyTask, CriticalState, FurtherState, Grasp, Insertion, Placing

# In a clean insertion a held part turns, moves once it is released, and takes time up to the first value;
# at the second the proposal is worthless. A released part may lean: that is no fault.
_TURN_DEG = (8.0, 30.0)
_SETTLING_M = (0.015, 0.03)
_DURATION_STEPS = (60.0, 240.0)
_SETTLING_STEPS = 10
# Steps that the fingers need to close, and how far a part moves that was picked up or pushed.
_CLOSING_STEPS = 6
_TAKEN_ALONG_M = 0.03


class AnnotationConfig(StrictConfig):
    """How critical states are proposed."""

    neighbourhood_m: float = Field(
        default=0.06, gt=0, le=10, description="distance from its assembled position within which a part arrives"
    )
    clearance_m: float = Field(default=0.006, gt=0, le=10, description="parts that are closer are about to touch")
    critical_states: Literal["task", "grasps", "all"] = Field(
        default="task",
        description="those of the task, or the grasp of every part as well, or both and the placing of the first part",
    )
    approach_m: float = Field(
        default=0.02, gt=0, le=10, description="distance from a grasp or a placing just before it"
    )


@dataclass(frozen=True)
class Proposal:
    """A critical state that the simulator's truth suggests.

    Attributes:
        step: Last step before the grasp or insertion.
        critical_state: Its index, see :func:`critical_states`.
        confidence: How cleanly what follows was done, between zero and one.
    """

    step: int
    critical_state: int
    confidence: float


def critical_states(task: AssemblyTask, config: AnnotationConfig) -> tuple[CriticalState | FurtherState, ...]:
    """What is looked for in a demonstration, by index."""
    counted = {"task": (), "grasps": (Grasp,), "all": (Grasp, Placing)}[config.critical_states]
    return (*task.critical_states, *(state for state in task.further_states if isinstance(state, counted)))


def propose(env: AssemblyEnv, demonstration: Episode, config: AnnotationConfig) -> list[Proposal]:
    """Proposals for the critical states of the demonstration's task that can be found in it.

    Args:
        env: Environment of the demonstration's task; its state is replaced.
        demonstration: A successful episode.
        config: How to propose.
    """
    proposals = []
    for index, state in enumerate(critical_states(env.task, config)):
        if isinstance(state, Insertion):
            found = _propose_insertion(env, demonstration, state, config)
        elif isinstance(state, Placing):
            found = _propose_placing(env, demonstration, config)
        else:
            found = _propose_grasp(env, demonstration, state, config)
        if found is not None:
            proposals.append(Proposal(found[0], index, found[1]))
    return proposals


def _propose_grasp(
    env: AssemblyEnv, demonstration: Episode, state: Grasp, config: AnnotationConfig
) -> tuple[int, float] | None:
    """Step and confidence; the more often the part was grasped in vain before, the lower."""
    part = env.task.parts[state.part].name
    commands = gripper_commands(demonstration.steps["action"])
    closings = np.flatnonzero((commands[1:] > 0) & (commands[:-1] < 0)) + 1
    on_part = [int(step) for step in closings if _is_touched(env, demonstration, part, int(step) + _CLOSING_STEPS)]
    # Screwing grasps a part again and again: what picks it up is the first grasp after which it is far from its start.
    taken = next((step for step in on_part if _is_taken_along(demonstration, state.part, step)), None)
    if taken is None:
        return None
    end_effector = np.asarray(demonstration.steps["proprioception"][: taken + 1, :3], dtype=np.float64)
    away = np.flatnonzero(np.linalg.norm(end_effector - end_effector[-1], axis=1) > config.approach_m)
    if len(away) == 0:
        return None
    return int(away[-1]), 1.0 / (1 + sum(step < taken for step in on_part))


def _is_touched(env: AssemblyEnv, demonstration: Episode, part: str, step: int) -> bool:
    step = min(step, len(demonstration) - 1)
    env.set_state(demonstration.state(step))
    return _is_in_gripper(env, part)


def _is_in_gripper(env: AssemblyEnv, part: str) -> bool:
    """Whether the gripper touches a part in the environment's present state."""
    return any({"gripper", part} == set(names) for names in env.contact_pairs())


def _is_taken_along(demonstration: Episode, part: int, step: int) -> bool:
    """Whether a part has moved by some centimetres when the gripper opens again."""
    opens = next_gripper_change(demonstration.steps["action"], step)
    end = len(demonstration) - 1 if opens is None else opens
    positions = _part_positions(demonstration.steps["part_poses"][[step, end]])[:, part]
    return bool(np.linalg.norm(positions[1] - positions[0]) > _TAKEN_ALONG_M)


def _part_positions(part_poses: NDArray[np.generic]) -> NDArray[np.float64]:
    """Positions ``(T, parts, 3)`` from poses ``(T, 7 * parts)``."""
    return np.asarray(part_poses, dtype=np.float64).reshape(len(part_poses), -1, 7)[:, :, :3]


def _propose_placing(env: AssemblyEnv, demonstration: Episode, config: AnnotationConfig) -> tuple[int, float] | None:
    """Step, and how soon the part was let go after it, between zero and one."""
    base = BaseProgress(env.task)
    positions = _part_positions(demonstration.steps["part_poses"])
    closed = gripper_commands(demonstration.steps["action"]) > 0
    arrival = next((step for step in np.flatnonzero(closed) if base.is_placed(positions[step])), None)
    if arrival is None:
        return None
    change = next_gripper_change(demonstration.steps["action"], int(arrival))
    release = len(demonstration) - 1 if change is None else change
    away = np.flatnonzero(np.linalg.norm(positions[:release, 0] - positions[release, 0], axis=1) > config.approach_m)
    if len(away) == 0 or not closed[away[-1] : release].all():
        return None
    step = int(away[-1])
    if not _is_touched(env, demonstration, env.task.parts[0].name, step):
        return None
    return step, _fade(release - step, _DURATION_STEPS)


def _propose_insertion(
    env: AssemblyEnv, demonstration: Episode, state: Insertion, config: AnnotationConfig
) -> tuple[int, float] | None:
    """Step, and how cleanly the part was inserted after it, between zero and one."""
    relative, distance = relative_poses(env.task, demonstration, state.pair)
    away = np.flatnonzero(distance > config.neighbourhood_m)
    if len(away) == 0 or away[-1] + 1 >= len(demonstration):
        return None
    arrival = int(away[-1]) + 1
    change = next_gripper_change(demonstration.steps["action"], arrival)
    release = len(demonstration) - 1 if change is None else change
    step = _last_clear_step(env, demonstration, state.pair, range(arrival, release), config.clearance_m)
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
    return step, confidence


def _last_clear_step(
    env: AssemblyEnv, demonstration: Episode, pair_index: int, steps: range, limit_m: float
) -> int | None:
    """Last of the steps at which the second part is held and farther than the limit from the first."""
    pair = env.task.pairs[pair_index]
    first, second = env.task.parts[pair.first].name, env.task.parts[pair.second].name
    closed = gripper_commands(demonstration.steps["action"]) > 0
    for step in reversed(steps):
        env.set_state(demonstration.state(step))
        if clearance_m(env.model, env.data, first, second, limit_m) >= limit_m:
            return step if closed[step] and _is_in_gripper(env, second) else None
    return None


def relative_poses(
    task: AssemblyTask, demonstration: Episode, pair_index: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Poses ``(T + 1, 7)`` of the second part in the first's frame, and distances ``(T + 1,)`` from the target."""
    pair = task.pairs[pair_index]
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
