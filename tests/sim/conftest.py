"""A leg held over its hole: the situation that every test of the threads starts from."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
import pytest

from juicer.episode import ACTION_SIZE
from juicer.geometry import (
    axis_rotation,
    matrix_to_quat,
    matrix_to_rot6d,
    quat_multiply,
    quat_to_matrix,
    rotvec_to_matrix,
)
from juicer.sim.env import NUM_ARM_JOINTS, AssemblyEnv
from juicer.sim.panda import GRIP_FORCE_N, RESET_JOINTS_RAD
from juicer.sim.scene import home_xy


@dataclass(frozen=True)
class Grasp:
    """How the gripper holds a part from above.

    Attributes:
        height_m: Height over the part's origin.
        half_width_m: Half the part's width there.
        flat_rad: Yaw at which the fingers lie flat on it.
        flat_every_rad: Turn after which they do again.
        clear_m: How far the open gripper goes up to turn back past it.
    """

    height_m: float
    half_width_m: float
    flat_rad: float = 0.0
    flat_every_rad: float = np.pi / 2
    clear_m: float = 0.0


GRASPS = {
    "square_table_leg4": Grasp(0.010, 0.0149),
    "round_table_leg": Grasp(0.032, 0.0212, flat_every_rad=np.pi / 6),
    "round_table_base": Grasp(0.004, 0.0233, flat_rad=np.pi / 4, clear_m=0.04),
    "lamp_bulb": Grasp(0.038, 0.0299),
}


class PartOverHole:
    """An environment whose gripper holds the second part of a pair over its hole; earlier pairs are assembled."""

    def __init__(self, task: str, pair: int, yaw_rad: float, height_m: float) -> None:
        """Hold the part ``height_m`` above its seat, turned by ``yaw_rad`` from its assembled pose."""
        self.env = AssemblyEnv(task)
        self.env.reset(seed=0)
        self.pair = self.env.task.pairs[pair]
        self.target = np.array(self.pair.targets[self.pair.operator_target])
        self.grasp = GRASPS[self.env.task.parts[self.pair.second].name]
        self._place(pair, yaw_rad, height_m)

    def _place(self, pair: int, yaw_rad: float, height_m: float) -> None:
        env, data = self.env, self.env.data
        poses = self.part_poses()
        base = env.task.parts[0]
        corner = [home - 2e-4 for home in home_xy(base)]
        poses[0] = [*corner, base.start[2] + 1e-4, *base.start[3:]]
        for earlier in env.task.pairs[:pair]:
            poses[earlier.second] = self._on(poses[earlier.first], np.array(earlier.targets[earlier.operator_target]))
        poses[self.pair.second] = self._on(poses[self.pair.first], self.target)
        self.hole = poses[self.pair.second, :3].copy()
        turn = rotvec_to_matrix(np.array([0.0, 0.0, yaw_rad]))
        poses[self.pair.second, 3:] = matrix_to_quat(turn @ quat_to_matrix(poses[self.pair.second, 3:]))
        poses[self.pair.second, 2] += height_m
        self.end_effector_yaw = self._flat_yaw()
        joints = RESET_JOINTS_RAD.copy()
        held = poses[self.pair.second, :3] + np.array([0, 0, self.grasp.height_m])
        goal = self.action(held, self.end_effector_yaw, grip=1.0)
        for _ in range(60):
            joints = env._controller.joint_targets(goal, joints)
        data.qpos[:NUM_ARM_JOINTS] = data.ctrl[:NUM_ARM_JOINTS] = joints
        env._views.fingers[:] = self.grasp.half_width_m
        data.ctrl[NUM_ARM_JOINTS] = -GRIP_FORCE_N
        data.qvel[:] = 0
        data.tree_asleep[:] = -11
        env.set_state(env.get_state())

    @staticmethod
    def _on(first: np.ndarray, target: np.ndarray) -> np.ndarray:
        """Pose of a part that has a pose in the frame of another."""
        position = first[:3] + quat_to_matrix(first[3:]) @ target[:3]
        return np.array([*position, *quat_multiply(first[3:], target[3:])])

    def _flat_yaw(self) -> float:
        """A yaw near zero at which the fingers lie flat on the part."""
        matrix = quat_to_matrix(self.part_poses()[self.pair.second, 3:])
        yaw = float(np.arctan2(matrix[1, 0], matrix[0, 0])) + self.grasp.flat_rad
        every = self.grasp.flat_every_rad
        return (yaw + every / 2) % every - every / 2

    def part_poses(self) -> np.ndarray:
        """View ``(5, 7)`` on the simulator's part poses."""
        return self.env._views.part_poses.reshape(-1, 7)

    def nudge(self, velocity_m_s: float) -> None:
        """Set everything that is assembled in motion along the table."""
        for part in (self.env.task.parts[0], *(self.env.task.parts[pair.second] for pair in self.env.task.pairs)):
            start = self.env.model.joint(part.name).dofadr[0]
            self.env.data.qvel[start : start + 2] = velocity_m_s
        self.env.data.tree_asleep[:] = -11

    def settle(self) -> None:
        """A step in which nothing is done, so that pairs that are assembled count as such."""
        self.env.step(self.action(self.end_effector(), self.end_effector_yaw, grip=1.0))

    def end_effector(self) -> np.ndarray:
        """End-effector position."""
        return self.env.observation()["proprioception"][:3].astype(float)

    def action(self, position: np.ndarray, yaw: float, grip: float) -> np.ndarray:
        """Action that points the gripper down at ``position``, turned by ``yaw``."""
        action = np.zeros(ACTION_SIZE)
        action[:3], action[9] = position, grip
        action[3:9] = matrix_to_rot6d(axis_rotation("z", yaw) @ axis_rotation("x", np.pi))
        return action

    def part(self) -> tuple[float, float, float]:
        """Height above the seat [m], yaw from the assembled pose and tilt [rad] of the part."""
        poses = self.part_poses()
        seat = self._on(poses[self.pair.first], self.target)
        matrix = quat_to_matrix(seat[3:]).T @ quat_to_matrix(poses[self.pair.second, 3:])
        yaw = float(np.arctan2(matrix[0, 2], matrix[0, 0]))
        height = float(poses[self.pair.second, 2] - seat[2])
        return height, yaw, float(np.arccos(min(1.0, matrix[1, 1])))

    def lower(self, steps: int, lead_m: float = 0.008) -> None:
        """Lower the held leg vertically, pressing with a bounded lead."""
        for _ in range(steps):
            below = np.array([*self.hole[:2], self.end_effector()[2] - lead_m])
            self.env.step(self.action(below, self.end_effector_yaw, grip=1.0))

    def release(self) -> None:
        """Open the gripper where it is."""
        here = self.end_effector()
        for _ in range(6):
            self.env.step(self.action(here, self.end_effector_yaw, grip=-1.0))

    def turn(self, turn_rad: float, steps: int = 12) -> None:
        """Grasp the standing part, turn it by ``turn_rad`` (clockwise is negative) and let go."""
        # Where the hand is flat on the part and has as much of the turn as possible before it.
        every = self.grasp.flat_every_rad
        wanted = -0.5 * turn_rad
        start = wanted + (self._flat_yaw() - wanted + every / 2) % every - every / 2
        height = self.part_poses()[self.pair.second, 2] + self.grasp.height_m
        above = np.array([*self.hole[:2], height])
        clear = above + np.array([0, 0, self.grasp.clear_m])
        for _ in range(round(self.grasp.clear_m / 0.01)):
            self.env.step(self.action(clear, self.end_effector_yaw, grip=-1.0))
        for yaw in np.linspace(self.end_effector_yaw, start, 12):
            self.env.step(self.action(clear, yaw, grip=-1.0))
        for _ in range(round(self.grasp.clear_m / 0.004)):
            self.env.step(self.action(above, start, grip=-1.0))
        for grip in (-1.0,) * 4 + (1.0,) * 6:
            self.env.step(self.action(above, start, grip))
        for yaw in np.linspace(start, start + turn_rad, steps):
            drive = -0.005 if turn_rad < 0 else 0.003
            self.env.step(self.action(np.array([*self.hole[:2], self.end_effector()[2] + drive]), yaw, grip=1.0))
        self.end_effector_yaw = start + turn_rad
        self.release()


@pytest.fixture
def part_over_hole():
    """Factory of :class:`PartOverHole`."""
    return PartOverHole


@pytest.fixture
def leg_over_hole():
    """Factory of :class:`PartOverHole` for the leg of one_leg."""
    return partial(PartOverHole, "one_leg", 0)
