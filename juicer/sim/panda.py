"""Franka Panda from primitives: exact kinematics and link inertias, a gripper that grips with 13 N a finger.

Sources: the published modified DH parameters and the link inertias of FurnitureBench's robot description; hand
and fingers, which have none there, carry the masses of Franka's data sheet. Deviations: joint armature is 0.1
instead of 0.01 kg m^2 and the arm is driven by joint position servos (FurnitureBench: operational-space torques);
gravity is compensated in both. The servos are critically damped and as compliant as those torques make the arm
(about 1 kN/m and 0.12 m/s at the largest lead), so that no command presses with more than some 30 N. The two fingers
are coupled, as in the real hand.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np

from juicer.sim.contacts import ARM, FINGER

ARM_JOINTS = tuple(f"panda_joint{number}" for number in range(1, 8))
NUM_ARM_JOINTS = len(ARM_JOINTS)
FINGER_JOINTS = ("panda_finger_joint1", "panda_finger_joint2")
FINGER_BODIES = tuple(joint.replace("_joint", "") for joint in FINGER_JOINTS)
END_EFFECTOR_SITE = "end_effector"
HAND_BODY = "panda_hand"
END_EFFECTOR_Z = 0.103399
"""Distance of the end-effector point from the hand's origin along its z axis [m]."""

RESET_JOINTS_RAD = np.array([-0.02630888, 0.3758795, 0.12485036, -2.1383357, -0.09431414, 2.49649072, 0.01921718])
RESET_JOINTS_RAD.setflags(write=False)
GRIP_FORCE_N = 13.0
FINGER_SPEED_M_S = 0.1

_QUARTER = math.pi / 2
_WHITE, _DARK = (0.92, 0.92, 0.90, 1.0), (0.22, 0.23, 0.25, 1.0)


@dataclass(frozen=True)
class _Link:
    """Placement in the previous link (metres; roll about x), inertia, joint limits and servo of one link."""

    position: tuple[float, float, float]
    roll: float
    mass: float
    center_of_mass: tuple[float, float, float]
    inertia: tuple[float, float, float, float, float, float]
    limits: tuple[float, float]
    stiffness: float
    damping: float
    torque: float


_LINKS = (
    _Link((0, 0, 0.333), 0.0, 4.9707, (0.0039, 0.0021, -0.0476),
          (0.70337, 0.70661, 0.00912, -0.00014, 0.00677, 0.01917), (-2.8973, 2.8973), 260, 44, 87),
    _Link((0, 0, 0), -_QUARTER, 0.6469, (-0.0031, -0.0287, 0.0035),
          (0.0079620, 0.0281100, 0.0259950, -0.0039250, 0.0102540, 0.0007040), (-1.7628, 1.7628), 260, 47, 87),
    _Link((0, -0.316, 0), _QUARTER, 3.2286, (0.0275, 0.0393, -0.0665),
          (0.03724, 0.03616, 0.01083, -0.00476, -0.01140, -0.01281), (-2.8973, 2.8973), 260, 39, 87),
    _Link((0.0825, 0, 0), _QUARTER, 3.5879, (-0.0532, 0.1044, 0.0275),
          (0.02585, 0.01955, 0.02832, 0.00780, -0.00133, 0.00864), (-3.0718, -0.0698), 210, 31, 87),
    _Link((-0.0825, 0.384, 0), -_QUARTER, 1.2259, (-0.0120, 0.0411, -0.0384),
          (0.03555, 0.02947, 0.00863, -0.00212, -0.00404, 0.00023), (-2.8973, 2.8973), 88, 6.8, 12),
    _Link((0, 0, 0), _QUARTER, 1.6666, (0.0601, -0.0141, -0.0105),
          (0.00196, 0.00435, 0.00543, 0.00011, -0.00116, 0.00034), (-0.0175, 3.7525), 70, 6.5, 12),
    _Link((0.088, 0, 0), _QUARTER, 0.7355, (0.0105, -0.0043, 0.0616),
          (0.01252, 0.01003, 0.00482, -0.00043, -0.00120, -0.00074), (-2.8973, 2.8973), 52, 4.8, 12),
)  # fmt: skip

# Visible capsules (link, from, to, radius); only the last ones can reach the table, and only those collide.
_CAPSULES = (
    (0, (0, 0, -0.19), (0, 0, -0.02), 0.065),
    (1, (0, 0, -0.05), (0, 0, 0.05), 0.062),
    (1, (0, -0.02, 0), (0, -0.20, 0), 0.060),
    (2, (0, 0, -0.10), (0, 0, -0.03), 0.058),
    (2, (0.0825, 0.02, 0.0), (0.0825, 0.07, 0.0), 0.050),
    (3, (0, 0, -0.05), (0, 0, 0.05), 0.058),
    (4, (0, 0.03, -0.24), (0, 0.06, -0.10), 0.052),
    (5, (0, 0, -0.05), (0, 0, 0.02), 0.050),
    (6, (0, 0, 0.02), (0, 0, 0.09), 0.045),
)
_FIRST_COLLIDING_LINK = 4

# Boxes of the left finger in its own frame (size, centre, roll about x) [m, rad]; the right one is mirrored.
_FINGER_BOXES = (
    ((0.022, 0.015, 0.020), (0, 0.0185, 0.011), 0.0),
    ((0.022, 0.0088, 0.0038), (0, 0.0068, 0.0022), 0.0),
    ((0.0175, 0.007, 0.0235), (0, 0.0159, 0.02835), math.radians(30)),
    ((0.0175, 0.0152, 0.0185), (0, 0.00758, 0.04525), 0.0),
)


def add_panda(spec: mujoco.MjSpec, gripper_width_m: float) -> None:
    """Add the robot at the world's origin, its joint servos, and a gripper that opens to ``gripper_width_m``."""
    parent = spec.worldbody
    parent.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CYLINDER, fromto=(0, 0, 0, 0, 0, 0.14), size=(0.07, 0, 0), rgba=_WHITE,
        contype=0, conaffinity=0, group=1,
    )  # fmt: skip
    for index, link in enumerate(_LINKS):
        parent = _add_link(spec, parent, index, link)
    hand = parent.add_body(
        name=HAND_BODY, pos=(0, 0, 0.107), quat=_roll_quat((0, 0, 1), -math.pi / 4), gravcomp=1.0,
        mass=0.73, ipos=(-0.01, 0, 0.03), inertia=(0.001, 0.0025, 0.0017), explicitinertial=True,
    )  # fmt: skip
    hand.add_geom(
        name="palm", type=mujoco.mjtGeom.mjGEOM_BOX, pos=(0, -0.002, 0.020), size=(0.0316, 0.102, 0.046),
        rgba=_WHITE, **FINGER.attributes(),
    )  # fmt: skip
    hand.add_site(name=END_EFFECTOR_SITE, pos=(0, 0, END_EFFECTOR_Z), rgba=(0, 0, 0, 0))
    for side, joint in zip((1, -1), FINGER_JOINTS, strict=True):
        _add_finger(hand, joint, side, gripper_width_m / 2)
    _add_grip(spec)


def _add_link(spec: mujoco.MjSpec, parent: mujoco.MjsBody, index: int, link: _Link) -> mujoco.MjsBody:
    body = parent.add_body(
        name=f"panda_link{index + 1}", pos=link.position, quat=_roll_quat((1, 0, 0), link.roll), gravcomp=1.0,
        mass=link.mass, ipos=link.center_of_mass, fullinertia=link.inertia, explicitinertial=True,
    )  # fmt: skip
    joint = ARM_JOINTS[index]
    body.add_joint(
        name=joint, type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0, 0, 1), range=link.limits, limited=True,
        armature=0.1, damping=(0.003, 0, 0),
    )  # fmt: skip
    servo = spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    servo.set_to_position(kp=link.stiffness, kv=link.damping)
    servo.forcelimited, servo.forcerange = True, (-link.torque, link.torque)
    servo.ctrllimited, servo.ctrlrange = True, link.limits
    for owner, start, end, radius in _CAPSULES:
        if owner == index:
            collides = index >= _FIRST_COLLIDING_LINK
            body.add_geom(
                type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=(*start, *end), size=(radius, 0, 0), rgba=_WHITE, group=1,
                **(ARM.attributes() if collides else {"contype": 0, "conaffinity": 0}),
            )  # fmt: skip
    return body


def _add_finger(hand: mujoco.MjsBody, joint: str, side: int, opening: float) -> None:
    finger = hand.add_body(
        name=joint.replace("_joint", ""), pos=(0, 0, 0.0584), gravcomp=1.0,
        mass=0.015, ipos=(0, 0.012 * side, 0.025), inertia=(2.4e-6, 2.4e-6, 7.5e-7), explicitinertial=True,
    )  # fmt: skip
    finger.add_joint(
        name=joint, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(0, side, 0), range=(0, opening), limited=True,
        armature=0.1, damping=(GRIP_FORCE_N / FINGER_SPEED_M_S, 0, 0), solref_limit=(0.005, 1),
        solimp_limit=(0.95, 0.99, 0.001, 0.5, 2),
    )  # fmt: skip
    for number, (size, center, roll) in enumerate(_FINGER_BOXES):
        finger.add_geom(
            name=f"{joint.replace('_joint', '')}_box{number}", type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=(center[0], side * center[1], center[2]), size=np.array(size) / 2,
            quat=_roll_quat((1, 0, 0), side * roll), rgba=_DARK, **FINGER.attributes(),
        )  # fmt: skip


def _add_grip(spec: mujoco.MjSpec) -> None:
    coupling = spec.add_equality(
        type=mujoco.mjtEq.mjEQ_JOINT, name1=FINGER_JOINTS[0], name2=FINGER_JOINTS[1],
        objtype=mujoco.mjtObj.mjOBJ_JOINT, solref=(0.005, 1),
    )  # fmt: skip
    coupling.data[:5] = (0, 1, 0, 0, 0)
    tendon = spec.add_tendon(name="gripper")
    for joint in FINGER_JOINTS:
        tendon.wrap_joint(joint, 1.0)
    grip = spec.add_actuator(name="gripper", target="gripper", trntype=mujoco.mjtTrn.mjTRN_TENDON)
    grip.set_to_motor()
    # A tendon force of 13 N pulls every finger with 13 N.
    grip.ctrllimited, grip.ctrlrange = True, (-GRIP_FORCE_N, GRIP_FORCE_N)


def _roll_quat(axis: tuple[int, int, int], angle: float) -> tuple[float, float, float, float]:
    half = math.sin(angle / 2)
    return (math.cos(angle / 2), axis[0] * half, axis[1] * half, axis[2] * half)
