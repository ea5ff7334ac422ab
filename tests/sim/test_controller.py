"""Inverse kinematics: exact where the joints can follow, harmless where they cannot."""

import mujoco
import numpy as np
import pytest

from juicer.geometry import matrix_to_rot6d, rotvec_to_matrix
from juicer.sim.controller import EndEffectorController
from juicer.sim.panda import END_EFFECTOR_SITE, RESET_JOINTS_RAD
from juicer.sim.scene import build_arm

POSITION = np.array([0.53, 0.0, 0.085])
DOWNWARDS = np.diag([1.0, -1.0, -1.0])


def action_of(tilt_deg: float, position: np.ndarray = POSITION) -> np.ndarray:
    rotation = rotvec_to_matrix(np.array([0.0, -np.deg2rad(tilt_deg), 0.0])) @ DOWNWARDS
    return np.concatenate([position, matrix_to_rot6d(rotation), [1.0]])


def follow(action: np.ndarray, steps: int = 100) -> tuple[np.ndarray, np.ndarray]:
    """Pose that an arm comes to which makes half of its way in every step."""
    controller, joints = EndEffectorController(), np.array(RESET_JOINTS_RAD)
    for _ in range(steps):
        joints += 0.5 * (controller.joint_targets(action, joints) - joints)
    model = build_arm()
    data = mujoco.MjData(model)
    data.qpos[:7] = joints
    mujoco.mj_kinematics(model, data)
    site = data.site(END_EFFECTOR_SITE)
    return site.xpos, site.xmat.reshape(3, 3)


@pytest.mark.parametrize("tilt_deg", [0.0, 30.0, -30.0])
def test_a_pose_within_reach_is_reached(tilt_deg):
    position, matrix = follow(action_of(tilt_deg))
    np.testing.assert_allclose(position, POSITION, atol=5e-4)
    np.testing.assert_allclose(matrix_to_rot6d(matrix), action_of(tilt_deg)[3:9], atol=5e-4)


def test_rows_of_any_length_that_are_not_quite_orthogonal_mean_the_same_rotation():
    controller, joints = EndEffectorController(), np.array(RESET_JOINTS_RAD)
    exact, sloppy = action_of(20.0), action_of(20.0)
    sloppy[3:6] *= 0.7
    sloppy[6:9] = 0.9 * sloppy[6:9] + 0.1 * exact[3:6]
    np.testing.assert_allclose(
        controller.joint_targets(sloppy, joints), controller.joint_targets(exact, joints), atol=1e-12
    )


@pytest.mark.parametrize("tilt_deg", [45.0, 54.0, 60.0, 75.0, 90.0])
def test_a_tilt_beyond_the_wrists_limit_costs_the_rotation_and_not_the_position(tilt_deg):
    position, _ = follow(action_of(tilt_deg))
    np.testing.assert_allclose(position, POSITION, atol=2e-3)


@pytest.mark.parametrize("seed", range(20))
def test_no_rotation_costs_the_position(seed):
    rng = np.random.default_rng(seed)
    sideways, tilt = rng.uniform(-np.pi, np.pi), np.deg2rad(rng.uniform(40.0, 110.0))
    rotation = rotvec_to_matrix(tilt * np.array([np.cos(sideways), np.sin(sideways), 0.0])) @ DOWNWARDS
    wanted = POSITION + rng.uniform([-0.1, -0.2, 0.0], [0.1, 0.2, 0.15])
    position, _ = follow(np.concatenate([wanted, matrix_to_rot6d(rotation), [1.0]]))
    np.testing.assert_allclose(position, wanted, atol=2e-3)


def test_an_arm_at_its_limit_comes_to_rest():
    controller, joints = EndEffectorController(), np.array(RESET_JOINTS_RAD)
    for _ in range(100):
        before = joints.copy()
        joints += 0.5 * (controller.joint_targets(action_of(54.0), joints) - joints)
    np.testing.assert_allclose(joints, before, atol=1e-3)
