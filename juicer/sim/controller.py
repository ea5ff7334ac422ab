"""End-effector controller: a 10-D pose target becomes joint targets for the arm's position servos.

Differential inverse kinematics (damped least squares with a pull towards the reset posture) runs once an action
on a model of the bare arm; the joint targets then move linearly over the action's 0.1 s. How far a target may lead
the measured pose is bounded, so that no command can wind up force: the servo pushes in proportion to the lead.
"""

from __future__ import annotations

from typing import Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from juicer.episode import ACTION_SIZE
from juicer.errors import InvalidAction
from juicer.geometry import SHORTEST_ROW, Array, degenerate_rotation
from juicer.gripper import GRIPPER_DEADBAND, GRIPPER_ENTRY
from juicer.sim.panda import END_EFFECTOR_SITE, GRIP_FORCE_N, NUM_ARM_JOINTS, RESET_JOINTS_RAD
from juicer.sim.scene import build_arm
from juicer.text import printable

MAX_LEAD_M = 0.02
"""The paper's teleoperation clips a step at 2.5 cm; 20 degrees is its bound on rotation."""
MAX_LEAD_RAD = np.deg2rad(20.0)
MAX_ACTION = 1.0
"""Largest entry of an action: metres, cosines, gripper."""
_ROUNDING = 1e-3

_ITERATIONS = 8
_TOLERANCE = 1e-4  # metres and radians together
_DAMPING_MATRIX = 1e-3**2 * np.eye(6)
# Where the joints' ranges keep the arm from a pose a millimetre counts as a tenth of a radian, and the damping is what
# keeps the arm from folding over: at a third of it a rotation out of reach can cost 15 cm.
_POSITION_WEIGHT, _LIMITED_DAMPING = 100.0, 0.5**2
_POSTURE_GAIN = 0.02
_HIGHEST_STEP = np.array(0.35)  # radians; as arrays, which numpy need not convert
_LOWEST_STEP = -_HIGHEST_STEP


def validate_action(action: object) -> Array:
    """The action as it is executed: rounded to float32, so that a stored action replays exactly.

    Raises:
        InvalidAction: If it is not a vector of 10 finite numbers in range.
    """
    given = real_numbers(action, "an action")
    if given.shape != (ACTION_SIZE,):
        raise InvalidAction(f"an action must have shape ({ACTION_SIZE},), got {given.shape}")
    with np.errstate(over="ignore"):  # what is too large for float32 becomes infinite, and is refused as such
        values = given.astype(np.float32)
    if not np.abs(values).max() <= MAX_ACTION + _ROUNDING:  # NaN compares false
        wish = f"lie within +-{MAX_ACTION}" if np.isfinite(values).all() else "be finite"
        raise InvalidAction(f"the entries of an action must {wish}, got {values.tolist()}")
    return values.astype(np.float64)


def check_action(action: object) -> None:
    """Refuse what :meth:`AssemblyEnv.step <juicer.sim.env.AssemblyEnv.step>` would refuse, without moving anything.

    Raises:
        InvalidAction: See :func:`validate_action`; or if the 6D rotation is degenerate.
    """
    _commanded_rotation(validate_action(action))


def real_numbers(values: object, what: str) -> NDArray[np.generic]:
    """An array of real numbers.

    Raises:
        InvalidAction: Naming ``what``, if it is none: text, truth values, complex numbers, lists of unequal length.
    """
    try:
        given = np.asarray(values)
    except Exception as error:  # unequal lengths, a tensor on a GPU or with a gradient, a stranger's __array__
        raise InvalidAction(f"{what} cannot be read as an array: {printable(error)}") from None
    if given.dtype.kind not in "fiu":
        raise InvalidAction(f"{what} must be an array of real numbers, got one of {given.dtype}")
    return given


class EndEffectorController:
    """Solves inverse kinematics for one robot. Holds no state from one action to the next."""

    def __reduce__(self) -> tuple[type[Self], tuple[()]]:
        """A copy is made anew: it needs views of its own into the arm model."""
        return type(self), ()

    def __init__(self) -> None:
        """Build the arm model; its fingers, which move the end effector nowhere, stay closed."""
        self._model = build_arm()
        self._data = data = mujoco.MjData(self._model)
        self._site = self._model.site(END_EFFECTOR_SITE).id
        self._joints = data.qpos
        self._position, self._matrix = data.site_xpos[self._site], data.site_xmat[self._site].reshape(3, 3)
        self._jacobian = np.zeros((6, self._model.nv))
        self._error, self._quat = np.empty(6), np.empty(4)
        self._lowest, self._highest = self._model.jnt_range.T.copy()
        self._posture = data.qpos.copy()
        self._posture[:NUM_ARM_JOINTS] = RESET_JOINTS_RAD

    def joint_targets(self, action: Array, joints_rad: Array) -> Array:
        """Joint angles ``(7,)`` that bring the end effector towards the action's pose.

        Args:
            action: Validated action ``(10,)``: position [m] and 6D rotation in the robot base frame.
            joints_rad: Present joint angles ``(7,)``.

        Raises:
            InvalidAction: If the 6D rotation is degenerate.
        """
        rotation = _commanded_rotation(action)
        self._joints[:NUM_ARM_JOINTS] = joints_rad
        mujoco.mj_kinematics(self._model, self._data)
        position = action[:3]
        self._measure_error(position, rotation)
        ahead, turned = self._error[:3], self._error[3:]
        lead, turn = mujoco.mju_norm3(ahead), mujoco.mju_norm3(turned)
        if lead > MAX_LEAD_M:
            ahead *= MAX_LEAD_M / lead
            position = self._position + ahead
        if turn > MAX_LEAD_RAD:
            turned *= MAX_LEAD_RAD / turn
            rotation = _rotation(turned) @ self._matrix
        self._solve(position, rotation)
        targets: Array = self._joints[:NUM_ARM_JOINTS].copy()
        return targets

    def joints_at(self, position: Array, rotation: Array, joints_rad: Array) -> Array:
        """Joint angles ``(7,)`` at which the end effector is at a pose, or as near to it as the arm reaches.

        Args:
            position: Where it shall be ``(3,)``, robot base frame [m].
            rotation: Its rotation matrix ``(3, 3)``.
            joints_rad: Joint angles ``(7,)`` from which they are sought.
        """
        self._joints[:NUM_ARM_JOINTS] = joints_rad
        mujoco.mj_kinematics(self._model, self._data)
        self._measure_error(position, rotation)
        self._solve(position, rotation)
        joints: Array = self._joints[:NUM_ARM_JOINTS].copy()
        return joints

    def _measure_error(self, position: Array, rotation: Array) -> None:
        """How far the end effector is from a pose: metres and, in the base frame, radians."""
        np.subtract(position, self._position, out=self._error[:3])
        mujoco.mju_mat2Quat(self._quat, (rotation @ self._matrix.T).ravel())
        mujoco.mju_quat2Vel(self._error[3:], self._quat, 1.0)

    def _solve(self, position: Array, rotation: Array) -> None:
        """Move the arm model from where it is until its end effector reaches the pose, or its limits keep it away."""
        start = self._joints.copy()
        if not self._reach(position, rotation):
            self._joints[:] = start
            self._approach(position, rotation)

    def _reach(self, position: Array, rotation: Array) -> bool:
        """Move the arm model, by the measured error, to the pose; False if it does not get there within its range."""
        model, data, joints = self._model, self._data, self._joints
        jacobian, error = self._jacobian, self._error
        solution = np.empty(6)
        for _ in range(_ITERATIONS):
            if mujoco.mju_norm(error) < _TOLERANCE:
                return True
            self._differentiate()
            posture = _POSTURE_GAIN * (self._posture - joints)
            gram = jacobian @ jacobian.T + _DAMPING_MATRIX
            mujoco.mju_cholFactor(gram, 0.0)
            mujoco.mju_cholSolve(solution, gram, error - jacobian @ posture)
            joints += _clipped(posture + jacobian.T @ solution, _LOWEST_STEP, _HIGHEST_STEP)
            if np.any((joints < self._lowest) | (joints > self._highest)):
                return False
            mujoco.mj_kinematics(model, data)
            self._measure_error(position, rotation)
        return bool(mujoco.mju_norm(error) < _TOLERANCE)

    def _approach(self, position: Array, rotation: Array) -> None:
        """Move the arm model as near to the pose as the ranges of its joints allow: the position first."""
        model, joints, jacobian, error = self._model, self._joints, self._jacobian, self._error
        step, factor, free = np.zeros(model.nv), np.empty((model.nv, model.nv + 7)), np.empty(model.nv, np.int32)
        damping = _LIMITED_DAMPING * np.eye(model.nv)
        for _ in range(_ITERATIONS):
            mujoco.mj_kinematics(model, self._data)
            self._measure_error(position, rotation)
            self._differentiate()
            jacobian[:3] *= _POSITION_WEIGHT
            error[:3] *= _POSITION_WEIGHT
            posture = _POSTURE_GAIN * (self._posture - joints)
            slope = -(jacobian.T @ error + _LIMITED_DAMPING * posture)
            curvature = jacobian.T @ jacobian + damping
            mujoco.mju_boxQP(step, factor, free, curvature, slope, self._lowest - joints, self._highest - joints)
            joints += step

    def _differentiate(self) -> None:
        """How the arm model's joints move its end effector, where it stands."""
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_jacSite(self._model, self._data, self._jacobian[:3], self._jacobian[3:], self._site)


def grip_command(action: Array, last: float) -> float:
    """Gripper force [N]: closing is negative; inside the deadband the last command stays."""
    gripper = action[GRIPPER_ENTRY]
    if abs(gripper) <= GRIPPER_DEADBAND:
        return last
    return -GRIP_FORCE_N if gripper > 0 else GRIP_FORCE_N


def _commanded_rotation(action: Array) -> Array:
    """What :func:`juicer.geometry.rot6d_to_matrix` gives, several times faster on a single rotation."""
    matrix = np.empty((3, 3))
    first, second, third = matrix
    first[:], second[:] = action[3:6], action[6:9]
    if mujoco.mju_normalize3(first) <= SHORTEST_ROW:
        raise degenerate_rotation()
    second -= mujoco.mju_dot3(first, second) * first
    if mujoco.mju_normalize3(second) <= SHORTEST_ROW:
        raise degenerate_rotation()
    mujoco.mju_cross(third, first, second)
    return matrix


def _clipped(values: Array, lowest: Array, highest: Array) -> Array:
    # Twice as fast as np.clip on a few numbers.
    clipped: Array = np.minimum(np.maximum(values, lowest), highest)
    return clipped


def _rotation(rotvec: Array) -> Array:
    angle = mujoco.mju_norm3(rotvec)
    quat, matrix = np.empty(4), np.empty(9)
    mujoco.mju_axisAngle2Quat(quat, rotvec / angle, angle)
    mujoco.mju_quat2Mat(matrix, quat)
    return matrix.reshape(3, 3)
