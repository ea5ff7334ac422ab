"""A leg held over its hole: the situation that every test of the threads starts from."""

from __future__ import annotations

import numpy as np
import pytest

from juicer.episode import ACTION_SIZE
from juicer.geometry import axis_rotation, matrix_to_quat, matrix_to_rot6d, quat_to_matrix, relative_pose
from juicer.sim.env import NUM_ARM_JOINTS, AssemblyEnv
from juicer.sim.panda import GRIP_FORCE_N, RESET_JOINTS_RAD

GRASP_ABOVE_ORIGIN_M = 0.010
HALF_LEG_M = 0.0149


class LegOverHole:
    """An environment whose gripper holds leg 4 upright over the operators' hole."""

    def __init__(self, leg_yaw_rad: float, height_m: float) -> None:
        """Hold the leg ``height_m`` above its seat, turned by ``leg_yaw_rad`` from its assembled pose."""
        self.env = AssemblyEnv()
        self.env.reset(seed=0)
        self.pair = self.env.task.pairs[0]
        self.target = np.array(self.pair.targets[self.pair.operator_target])
        # The nearest quarter turn at which the fingers lie flat on the leg.
        self.hand_yaw = (leg_yaw_rad + np.pi / 4) % (np.pi / 2) - np.pi / 4
        self._place(leg_yaw_rad, height_m)

    def _place(self, leg_yaw_rad: float, height_m: float) -> None:
        env, data = self.env, self.env.data
        poses = self.part_poses()
        poses[0] = [0.59, 0.0836, env.task.parts[0].start[2] + 1e-4, *env.task.parts[0].start[3:]]
        top = quat_to_matrix(poses[0, 3:])
        self.hole = poses[0, :3] + top @ self.target[:3]
        poses[4, :3] = self.hole + np.array([0, 0, height_m])
        poses[4, 3:] = matrix_to_quat(top @ axis_rotation("y", leg_yaw_rad))
        joints = RESET_JOINTS_RAD.copy()
        goal = self.action(poses[4, :3] + np.array([0, 0, GRASP_ABOVE_ORIGIN_M]), self.hand_yaw, grip=1.0)
        for _ in range(60):
            joints = env._controller.joint_targets(goal, joints)
        data.qpos[:NUM_ARM_JOINTS] = data.ctrl[:NUM_ARM_JOINTS] = joints
        data.qpos[env._fingers] = HALF_LEG_M
        data.ctrl[NUM_ARM_JOINTS] = -GRIP_FORCE_N
        data.qvel[:] = 0
        data.tree_asleep[:] = -11
        env.set_state(env.get_state())

    def part_poses(self) -> np.ndarray:
        """View ``(5, 7)`` on the simulator's part poses."""
        return self.env.data.qpos[self.env._parts].reshape(-1, 7)

    def hand(self) -> np.ndarray:
        """End-effector position."""
        return self.env.observation()["proprioception"][:3].astype(float)

    def action(self, position: np.ndarray, yaw: float, grip: float) -> np.ndarray:
        """Action that points the gripper down at ``position``, turned by ``yaw``."""
        action = np.zeros(ACTION_SIZE)
        action[:3], action[9] = position, grip
        action[3:9] = matrix_to_rot6d(axis_rotation("z", yaw) @ axis_rotation("x", np.pi))
        return action

    def leg(self) -> tuple[float, float, float]:
        """Height above the seat [m], yaw from the assembled pose and tilt [rad] of the leg."""
        poses = self.part_poses()
        relative = relative_pose(poses[0], poses[4])
        matrix = quat_to_matrix(relative[3:])
        yaw = float(np.arctan2(matrix[0, 2], matrix[0, 0]))
        return float(relative[1] - self.target[1]), yaw, float(np.arccos(min(1.0, matrix[1, 1])))

    def lower(self, steps: int, lead_m: float = 0.008) -> None:
        """Lower the held leg vertically, pressing with a bounded lead."""
        for _ in range(steps):
            below = np.array([*self.hole[:2], self.hand()[2] - lead_m])
            self.env.step(self.action(below, self.hand_yaw, grip=1.0))

    def release(self) -> None:
        """Open the gripper where it is."""
        here = self.hand()
        for _ in range(6):
            self.env.step(self.action(here, self.hand_yaw, grip=-1.0))

    def turn(self, turn_rad: float, steps: int = 12) -> None:
        """Grasp the standing leg, turn it by ``turn_rad`` (clockwise is negative) and let go."""
        flat = (self.leg()[1] + np.pi / 4) % (np.pi / 2) - np.pi / 4
        start = flat - np.sign(turn_rad) * np.pi / 2 if abs(flat - np.sign(turn_rad) * np.pi / 2) < 1.1 else flat
        height = self.part_poses()[4, 2] + GRASP_ABOVE_ORIGIN_M
        above = np.array([*self.hole[:2], height])
        for yaw in np.linspace(self.hand_yaw, start, 12):
            self.env.step(self.action(above, yaw, grip=-1.0))
        for grip in (-1.0,) * 4 + (1.0,) * 6:
            self.env.step(self.action(above, start, grip))
        for yaw in np.linspace(start, start + turn_rad, steps):
            drive = -0.005 if turn_rad < 0 else 0.003
            self.env.step(self.action(np.array([*self.hole[:2], self.hand()[2] + drive]), yaw, grip=1.0))
        self.hand_yaw = start + turn_rad
        self.release()


@pytest.fixture
def leg_over_hole():
    """Factory of :class:`LegOverHole`."""
    return LegOverHole
