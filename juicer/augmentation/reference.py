"""What a demonstration did from a critical state on: what a snippet joins and must arrive at."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from juicer.episode import Episode
from juicer.gripper import gripper_commands, next_gripper_change

GRIPPER_WIDTH = 15
"""Index of the gripper's opening in proprioception."""

_STEPS_BEFORE_GRASP = 15
"""Where the way to a grasp begins at the earliest: early enough for the end effector to get millimetres aside."""


@dataclass(frozen=True)
class Expected:
    """What the demonstration showed at a step.

    Attributes:
        remaining: Actions of the reference that follow it.
        part_poses: Part poses ``(7 * parts,)``.
        gripper_width_m: Opening of the gripper.
    """

    remaining: int
    part_poses: NDArray[np.float32]
    gripper_width_m: float


@dataclass(frozen=True)
class GraspBefore:
    """The way from just before the grasp of what is held at a critical state to that state.

    Attributes:
        state: Simulator state, with the gripper open.
        actions: The demonstration's actions from there to the critical state ``(T, 10)``.
    """

    state: NDArray[np.float64]
    actions: NDArray[np.float32]


@dataclass(frozen=True)
class Reference:
    """The piece of a demonstration from a critical state to where a snippet is checked.

    Attributes:
        parent: Id of the demonstration.
        task: Its assembly task.
        randomness: Level of its initial state.
        seed: Its initial-state seed.
        critical_state: Index of the critical state.
        state: Simulator state at the critical state.
        pose: End-effector pose there ``(9,)``.
        gripper: What the gripper is commanded there: +1 close, -1 open.
        phase: End-effector poses from the gripper change before it to the one after it ``(N, 9)``.
        actions: The demonstration's actions from there to the end ``(T, 10)``.
        change: What a snippet must show when the gripper's command changes.
        end: What it must show after all actions.
        grasp: How the demonstration came to hold what it holds there; None if it is open, or was never before.
    """

    parent: str
    task: str
    randomness: str
    seed: int
    critical_state: int
    state: NDArray[np.float64]
    pose: NDArray[np.float32]
    gripper: float
    phase: NDArray[np.float32]
    actions: NDArray[np.float32]
    change: Expected
    end: Expected
    grasp: GraspBefore | None


def reference_of(demonstration: Episode, step: int, critical_state: int, steps_after_gripper_change: int) -> Reference:
    """Cut the reference of one critical state out of its demonstration.

    It ends ``steps_after_gripper_change`` actions after the next gripper change, or with the demonstration.

    Args:
        demonstration: The annotated demonstration.
        step: The critical state's step.
        critical_state: Its index.
        steps_after_gripper_change: How far to follow.
    """
    steps, record = demonstration.steps, demonstration.record
    actions = np.asarray(steps["action"], dtype=np.float32)
    change = next_gripper_change(actions, step)
    change = len(actions) if change is None else change
    commands = gripper_commands(actions)
    begin = _last_change(commands, step)
    end = min(change + steps_after_gripper_change, len(actions))

    def expected(index: int) -> Expected:
        shown = demonstration.observation(index)
        return Expected(
            remaining=end - index,
            part_poses=np.array(shown["part_poses"], dtype=np.float32),
            gripper_width_m=float(shown["proprioception"][GRIPPER_WIDTH]),
        )

    return Reference(
        parent=record.episode_id,
        task=record.task,
        randomness=record.randomness,
        seed=record.seed,
        critical_state=critical_state,
        state=demonstration.state(step).copy(),
        pose=np.array(steps["proprioception"][step][:9], dtype=np.float32),
        gripper=float(commands[step]),
        phase=np.array(steps["proprioception"][begin:change, :9], dtype=np.float32),
        actions=actions[step:end].copy(),
        change=expected(change),
        end=expected(end),
        grasp=_grasp_before(demonstration, step, commands, begin),
    )


def _grasp_before(demonstration: Episode, step: int, commands: NDArray[np.float64], closed: int) -> GraspBefore | None:
    if commands[step] < 0 or closed == 0:
        return None
    # Not before the gripper opened for it: what it held until then must not be moved.
    before = max(closed - _STEPS_BEFORE_GRASP, _last_change(commands, closed - 1))
    actions = np.asarray(demonstration.steps["action"][before:step], dtype=np.float32)
    return GraspBefore(demonstration.state(before).copy(), actions)


def _last_change(commands: NDArray[np.float64], step: int) -> int:
    """First step of those up to ``step`` that have its command without a break."""
    return int(np.flatnonzero(np.append(True, commands[1 : step + 1] != commands[:step]))[-1])
