"""The whole scene of a task as one MuJoCo model. The world frame is the robot base frame.

Physics settings were chosen by measurement: a step of 2 ms is the longest at which beads neither tunnel nor chatter;
elliptic cones with an impedance ratio above one inject energy into parts at rest.
"""

from __future__ import annotations

import mujoco
import numpy as np

from juicer.sim.contacts import FIXTURE, TABLE
from juicer.sim.panda import END_EFFECTOR_Z, HAND_BODY, add_panda
from juicer.sim.parts import add_part
from juicer.tasks.specification import TABLE_HEIGHT_M, AssemblyTask, PartSpec
from juicer.views import FRONT_CAMERA, WRIST_CAMERA

TIMESTEP_S = 0.002
FLOOR_HEIGHT_M = -0.43

# Fence bars (centre x, y; half extents), a U open towards the robot; inner faces at x 0.6715 and y +-0.165.
FENCE = (
    ((0.6815, 0.0), (0.01, 0.175)),
    ((0.6065, -0.175), (0.085, 0.01)),
    ((0.6065, 0.175), (0.085, 0.01)),
)
FENCE_HEIGHT_M = 0.03
FENCE_CORNER_XY = (0.6715, 0.165)
"""Where the inner faces of the front and the left bar meet [m]."""


def home_xy(part: PartSpec) -> tuple[float, float]:
    """Centre of a part whose outer faces lie at the inner faces of the fence's corner, not turned [m]."""
    width, depth = part.footprint
    return FENCE_CORNER_XY[0] - width / 2, FENCE_CORNER_XY[1] - depth / 2


def build_spec(task: AssemblyTask) -> mujoco.MjSpec:
    """Model of robot, table, fence and the task's parts, not compiled."""
    spec = mujoco.MjSpec()
    spec.modelname = task.name
    spec.compiler.degree = False
    _set_physics(spec, task)
    _add_workspace(spec)
    add_panda(spec, task.gripper_width_m)
    for part in task.parts:
        add_part(spec, part)
    _add_cameras(spec)
    return spec


def build_arm() -> mujoco.MjModel:
    """Model of the bare robot, on which the controller solves inverse kinematics."""
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    add_panda(spec, gripper_width_m=0.08)
    return spec.compile()


def _set_physics(spec: mujoco.MjSpec, task: AssemblyTask) -> None:
    option = spec.option
    option.timestep = TIMESTEP_S
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    option.iterations, option.ls_iterations, option.tolerance = 20, 50, 1e-6
    # Without these, friction yields slowly: a hood slides out of the grip by 16 mm in seven seconds, and a ball that is
    # not held at its middle is squeezed out within four. With four iterations it is 0.05 mm.
    option.noslip_iterations = 4
    option.gravity = (0, 0, -9.8)
    # Mounted parts keep touching: with several of them, a dense matrix makes a step up to 1.8 times as long.
    mounts_several = len(task.pairs) > 1
    option.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE if mounts_several else mujoco.mjtJacobian.mjJAC_DENSE
    # Parts at rest sleep until touched: a step costs a third of what it costs when all five rest awake.
    option.enableflags |= int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    # Divergence is reported as an outcome; an automatic reset would hide it.
    option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    spec.default.geom.solref[:2] = (0.005, 1)
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 1280, 720
    spec.visual.quality.shadowsize = 2048
    # Coarse round shapes: drawn in software, images cost in proportion to triangles.
    spec.visual.quality.numslices, spec.visual.quality.numstacks = 14, 8
    spec.visual.map.znear, spec.visual.map.zfar = 0.01, 10.0


def _add_workspace(spec: mujoco.MjSpec) -> None:
    world = spec.worldbody
    world.add_geom(
        name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, pos=(0, 0, FLOOR_HEIGHT_M), size=(3, 3, 0.1),
        rgba=(0.35, 0.36, 0.38, 1), **TABLE.attributes(),
    )  # fmt: skip
    world.add_geom(
        name="table", type=mujoco.mjtGeom.mjGEOM_BOX, pos=(0.3, 0, TABLE_HEIGHT_M - 0.015), size=(0.65, 0.4, 0.015),
        rgba=(0.19, 0.19, 0.19, 1), **TABLE.attributes(),
    )  # fmt: skip
    for number, (center, half) in enumerate(FENCE):
        world.add_geom(
            name=f"fence{number}", type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=(*center, TABLE_HEIGHT_M + FENCE_HEIGHT_M / 2), size=(*half, FENCE_HEIGHT_M / 2),
            rgba=(0.95, 0.95, 0.95, 1), **FIXTURE.attributes(),
        )  # fmt: skip
    wall = {"type": mujoco.mjtGeom.mjGEOM_BOX, "rgba": (0.0, 0.45, 0.27, 1), "contype": 0, "conaffinity": 0}
    world.add_geom(name="backdrop", pos=(-0.5, 0, 0.32), size=(0.005, 0.75, 0.75), **wall)
    spec.visual.headlight.ambient = (0.35, 0.35, 0.35)
    spec.visual.headlight.diffuse = (0.25, 0.25, 0.25)
    spec.visual.headlight.specular = (0.1, 0.1, 0.1)
    world.add_light(
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, pos=(0.3, 0, 2), dir=(-0.42, 0.13, -0.85), diffuse=(0.6, 0.6, 0.6)
    )


def _add_cameras(spec: mujoco.MjSpec) -> None:
    """Front and wrist cameras at FurnitureBench's poses (vertical field of view 42.56 degrees)."""
    spec.worldbody.add_camera(
        name=FRONT_CAMERA, pos=(1.20, 0, 0.22), quat=_camera_quat((0, 1, 0), (-0.181, 0, 0.983)), fovy=42.56
    )
    spec.body(HAND_BODY).add_camera(
        name=WRIST_CAMERA, pos=(-0.04, 0, END_EFFECTOR_Z - 0.05),
        quat=_camera_quat((0, -1, 0), (-0.940, 0, 0.342)), fovy=42.56,
    )  # fmt: skip


def _camera_quat(x_axis: tuple[float, ...], y_axis: tuple[float, ...]) -> np.ndarray:
    x, y = np.asarray(x_axis, float), np.asarray(y_axis, float)
    y = y / np.linalg.norm(y)
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, np.stack([x, y, np.cross(x, y)], axis=1).flatten())
    return quat
