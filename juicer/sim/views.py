"""The simulator's arrays by what they mean, so that the environment need not look up indices at every step."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from juicer.sim.panda import END_EFFECTOR_SITE, FINGER_JOINTS, NUM_ARM_JOINTS
from juicer.tasks.specification import AssemblyTask

Array = NDArray[np.float64]


class SceneViews:
    """Views into one ``MjData``: they show its present state, and writing to them changes it.

    They belong to that ``MjData`` alone. A copy of an environment makes its own.

    Attributes:
        site: Id of the end effector's site.
        position: End-effector position ``(3,)``, robot base frame [m].
        matrix_rows: First two rows of its rotation matrix ``(6,)``.
        joints: Arm joints ``(7,)`` [rad].
        joint_targets: What their servos are told ``(7,)`` [rad].
        controls: Everything the actuators are told ``(8,)``; the last is the gripper's force [N].
        fingers: Positions of both fingers ``(2,)`` [m].
        velocities: Velocities of all joints ``(nv,)``.
        part_poses: Poses of all parts ``(7 P,)``, quaternions wxyz.
        part_positions: Positions of their frames ``(P, 3)`` [m].
        part_matrices: Their rotation matrices ``(P, 3, 3)``.
        rolling: Where in ``velocities`` those of parts stand that are kept from rolling.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, task: AssemblyTask) -> None:
        """Look up where things stand in the arrays of ``data``."""
        self.site: int = model.site(END_EFFECTOR_SITE).id
        self.position: Array = data.site_xpos[self.site]
        self.matrix_rows: Array = data.site_xmat[self.site, :6]
        self.joints: Array = data.qpos[:NUM_ARM_JOINTS]
        self.joint_targets: Array = data.ctrl[:NUM_ARM_JOINTS]
        self.controls: Array = data.ctrl
        left_finger = model.joint(FINGER_JOINTS[0]).qposadr[0]
        self.fingers: Array = data.qpos[left_finger : left_finger + len(FINGER_JOINTS)]
        self.velocities: Array = data.qvel
        first = model.joint(task.parts[0].name).qposadr[0]
        self.part_poses: Array = data.qpos[first : first + 7 * len(task.parts)]
        first_body = model.body(task.parts[0].name).id
        bodies = slice(first_body, first_body + len(task.parts))
        self.part_positions: Array = data.xpos[bodies]
        self.part_matrices: Array = data.xmat[bodies].reshape(-1, 3, 3)
        starts = [model.joint(part.name).dofadr[0] for part in task.parts if part.rolls]
        self.rolling = [slice(start, start + 6) for start in starts]
