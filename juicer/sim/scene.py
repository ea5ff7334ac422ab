"""The whole scene of a task as one MuJoCo model. The world frame is the robot base frame.

Physics settings were chosen by measurement: a step of 2 ms is the longest at which beads neither tunnel nor chatter;
elliptic cones with an impedance ratio above one inject energy into parts at rest.
"""

from __future__ import annotations

import logging

import mujoco

from juicer.sim.contacts import FIXTURE, TABLE
from juicer.sim.panda import add_panda
from juicer.sim.parts import add_part
from juicer.tasks.specification import TABLE_HEIGHT_M, AssemblyTask, PartSpec

# MuJoCo would print its warnings and write MUJOCO_LOG.TXT into the working directory, in every process.
mujoco.set_mju_user_warning(logging.getLogger(__name__).debug)

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
