"""What of a scene is seen, as a MuJoCo model of its own: the same bodies and joints as in the physics, other geometry.

It has the simulated model's ``qpos`` and is drawn from that alone. Nothing in it collides or moves by itself, so what
is drawn can be changed without changing any result. Every part is a few meshes, one a colour: in software, drawing
costs in proportion to the number of geoms, and the physics of a thread needs dozens.
"""

from __future__ import annotations

import math
from functools import lru_cache

import mujoco
import numpy as np

from juicer.imaging.cameras import add_cameras
from juicer.imaging.look import Look
from juicer.imaging.panda_mesh import add_panda_mesh
from juicer.imaging.parts import painted_surfaces
from juicer.imaging.surfaces import Surface
from juicer.sim.scene import build_spec
from juicer.tasks.registry import get_task
from juicer.tasks.specification import AssemblyTask, PartSpec

_NEAR_M, _FAR_M = 0.01, 6.0
_SHADOW_REACH_M = 0.8
_LAYER_M = 5e-5
_WALL_YAW_RAD = math.radians(20.4)


@lru_cache(maxsize=8)
def visual_model(task_name: str, look: Look) -> mujoco.MjModel:
    """Model of a task to be drawn, compiled once a process.

    Raises:
        ConfigError: If there is no such task.
    """
    return visual_spec(get_task(task_name), look).compile()


def visual_spec(task: AssemblyTask, look: Look) -> mujoco.MjSpec:
    """The same, not compiled."""
    spec = build_spec(task)
    names = {part.name for part in task.parts}
    for geom in list(spec.geoms):
        if geom.parent.name in names:
            spec.delete(geom)
        else:
            geom.contype = geom.conaffinity = 0
    for bar in ("fence1", "fence2"):
        # Where bars meet, it is decided which of them is seen.
        spec.geom(bar).size -= _LAYER_M
    if look.robot == "mesh":
        add_panda_mesh(spec)
    for part in task.parts:
        _add_part(spec, part)
    add_cameras(spec)
    _add_walls(spec)
    _add_light(spec, look)
    _set_quality(spec, look)
    return spec


def _add_part(spec: mujoco.MjSpec, part: PartSpec) -> None:
    body = spec.body(part.name)
    for number, (rgb, surface) in enumerate(painted_surfaces(part)):
        name = f"{part.name}_{number}"
        _add_mesh(spec, name, surface)
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, rgba=(*rgb, 1.0), contype=0, conaffinity=0)


def _add_mesh(spec: mujoco.MjSpec, name: str, surface: Surface) -> None:
    mesh = spec.add_mesh(name=name)
    mesh.uservert, mesh.usernormal = surface.vertices.ravel(), surface.normals.ravel()
    mesh.userface = mesh.userfacenormal = surface.faces.astype(np.int32).ravel()
    # Most are not closed, so they have no volume of which to compute an inertia.
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL


def _add_walls(spec: mujoco.MjSpec) -> None:
    """FurnitureBench's green walls beside the one behind the robot, which slant away from it."""
    for side in (1, -1):
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX, pos=(0.2, 0.95 * side, 0.32), size=(0.747, 0.005, 0.75),
            quat=(math.cos(_WALL_YAW_RAD / 2), 0, 0, math.sin(side * _WALL_YAW_RAD / 2)), rgba=(0.0, 0.45, 0.27, 1),
            contype=0, conaffinity=0,
        )  # fmt: skip


def _add_light(spec: mujoco.MjSpec, look: Look) -> None:
    """A lamp above the front, and some light from everywhere: more of it where things cast shadows."""
    from_everywhere, from_the_lamp, gloss = (0.7, 0.42, 0.25) if look.is_film else (0.5, 0.55, 0.0)
    headlight = spec.visual.headlight
    headlight.ambient, headlight.diffuse = (0.65 * from_everywhere,) * 3, (0.35 * from_everywhere,) * 3
    headlight.specular = (0.0,) * 3
    spec.worldbody.add_light(
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, pos=(0.9, -0.1, 1.2), dir=(-0.42, 0.05, -0.85),
        diffuse=(from_the_lamp,) * 3, specular=(gloss,) * 3,
    )  # fmt: skip


def _set_quality(spec: mujoco.MjSpec, look: Look) -> None:
    visual = spec.visual
    visual.quality.offsamples = look.samples
    visual.quality.shadowsize = 4096
    visual.global_.offwidth, visual.global_.offheight = 1280, 720
    # These are multiples of the scene's extent, which else depends on what is in it.
    spec.stat.extent = 1.0
    visual.map.znear, visual.map.zfar = _NEAR_M, _FAR_M
    visual.map.shadowclip = _SHADOW_REACH_M
