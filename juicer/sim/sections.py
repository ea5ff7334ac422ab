"""The parts of a simulator state that can be read without restoring it."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from juicer.errors import InvalidEpisode
from juicer.sim.env import AssemblyEnv
from juicer.sim.panda import FINGER_JOINTS, NUM_ARM_JOINTS
from juicer.tasks.specification import AssemblyTask

LARGEST_VALUE = 1e10
"""MuJoCo calls a value beyond this huge, and what it belongs to unstable."""


@dataclass(frozen=True)
class StateSections:
    """Parts of the simulator states ``(N, S)`` of one scene.

    Attributes:
        time_s: Simulated time since the reset ``(N,)``.
        part_poses: Poses of the parts as observed ``(N, 7 * P)``.
        gripper_width_m: Opening of the gripper ``(N,)``.
        asleep: For each tree of bodies that sleeps the next in a ring of those that sleep together, negative for one
            that is awake ``(N, trees)``.
        num_steps: Steps since the reset ``(N,)``.
        assembled: Whether each pair counts as assembled ``(N, pairs)``.
    """

    time_s: NDArray[np.float64]
    part_poses: NDArray[np.float64]
    gripper_width_m: NDArray[np.float64]
    asleep: NDArray[np.float64]
    num_steps: NDArray[np.float64]
    assembled: NDArray[np.float64]

    @classmethod
    def of(cls, env: AssemblyEnv, states: NDArray[np.float64]) -> StateSections:
        """Cut up states of an environment's scene."""
        model = env.model
        asleep = mujoco.mj_stateSize(model, int(mujoco.mjtState.mjSTATE_INTEGRATION))
        progress = asleep + model.ntree
        positions = states[:, 1 : 1 + model.nq]
        first_part = model.joint(env.task.parts[0].name).qposadr[0]
        fingers = [model.joint(name).qposadr[0] for name in FINGER_JOINTS]
        return cls(
            time_s=states[:, 0],
            part_poses=positions[:, first_part : first_part + 7 * len(env.task.parts)],
            gripper_width_m=positions[:, fingers].sum(axis=1),
            asleep=states[:, asleep:progress],
            num_steps=states[:, progress],
            assembled=states[:, progress + 1 : progress + 1 + len(env.task.pairs)],
        )

    def has_rings(self) -> NDArray[np.bool_]:
        """Whether the sleeping bodies of each state form rings, which MuJoCo follows without looking ``(N,)``."""
        trees = np.arange(self.asleep.shape[1])
        sleeping = self.asleep >= 0
        followers = np.sort(np.where(sleeping, self.asleep, len(trees)), axis=1)
        sleepers = np.sort(np.where(sleeping, trees, len(trees)), axis=1)
        is_whole = (self.asleep == np.rint(self.asleep)) & (np.abs(self.asleep) < 2**31)
        rings: NDArray[np.bool_] = is_whole.all(axis=1) & (followers == sleepers).all(axis=1)
        return rings


def joint_positions(task: AssemblyTask, states: NDArray[np.float64]) -> NDArray[np.float64]:
    """Positions of all joints ``(N, nq)`` in simulator states ``(N, S)`` of a task's scene; enough to draw it.

    Raises:
        InvalidEpisode: If they cannot be states of such a scene.
    """
    size = NUM_ARM_JOINTS + len(FINGER_JOINTS) + 7 * len(task.parts)
    positions = states[:, 1 : 1 + size]
    if positions.shape[1] < size or not np.isfinite(positions).all():
        raise InvalidEpisode(
            f"these are not simulator states of {task.name}: they are too short, or hold positions that are no numbers"
        )
    return positions
