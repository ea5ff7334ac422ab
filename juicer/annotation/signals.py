"""What an annotator sees beside the images: how the gripper moves, what touches what, the distance to the target."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from juicer.annotation.propose import relative_poses
from juicer.episode import Episode
from juicer.gripper import gripper_commands
from juicer.sim.env import AssemblyEnv
from juicer.tasks.specification import CriticalState, Insertion

Signal = NDArray[np.float64]


@dataclass(frozen=True)
class Signals:
    """Signals of a demonstration of ``T`` steps.

    Attributes:
        gripper_width_m: Opening of the gripper ``(T,)``.
        closing: Whether the gripper is told to close ``(T,)``.
        height_m: Height of the end effector in the robot base frame ``(T,)``.
        speed_m_s: Its speed ``(T,)``.
        contacts: How many pairs of parts, or of a part and the gripper, touch ``(T,)``.
        distance_m: Distance of what a critical state is about from where it goes ``(T,)``: of an inserted part from its
            place, of the end effector from a part that is grasped. One for each critical state of the task.
    """

    gripper_width_m: Signal
    closing: NDArray[np.bool_]
    height_m: Signal
    speed_m_s: Signal
    contacts: NDArray[np.int64]
    distance_m: tuple[Signal, ...]


def signals_of(env: AssemblyEnv, demonstration: Episode) -> Signals:
    """Signals of a demonstration.

    Args:
        env: Environment of its task; its state is replaced.
        demonstration: An episode with simulator states.
    """
    proprioception = np.asarray(demonstration.steps["proprioception"], dtype=np.float64)
    return Signals(
        gripper_width_m=proprioception[:, 15],
        closing=gripper_commands(demonstration.steps["action"]) > 0,
        height_m=proprioception[:, 2],
        speed_m_s=np.linalg.norm(proprioception[:, 9:12], axis=1),
        contacts=np.array([_num_contacts(env, demonstration, step) for step in range(len(demonstration))]),
        distance_m=tuple(_distance_m(env, demonstration, state) for state in env.task.critical_states),
    )


def _num_contacts(env: AssemblyEnv, demonstration: Episode, step: int) -> int:
    env.set_state(demonstration.state(step))
    movable = {"gripper", *(part.name for part in env.task.parts)}
    return sum(movable.issuperset(pair) for pair in env.contact_pairs())


def _distance_m(env: AssemblyEnv, demonstration: Episode, state: CriticalState) -> Signal:
    if isinstance(state, Insertion):
        return relative_poses(env.task, demonstration, state.pair)[1][:-1]
    part = np.asarray(demonstration.steps["part_poses"], dtype=np.float64)[:, 7 * state.part : 7 * state.part + 3]
    gripper = np.asarray(demonstration.steps["proprioception"], dtype=np.float64)[:, :3]
    distance: Signal = np.linalg.norm(part - gripper, axis=1)
    return distance
