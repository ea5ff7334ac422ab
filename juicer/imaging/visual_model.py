"""What of a scene is seen, as a MuJoCo model of its own: the same bodies and joints as in the physics, other geometry.

It has the simulated model's ``qpos`` and is drawn from that alone. Nothing in it collides or moves by itself, so what
is drawn can be changed without changing any result. Every part is a few meshes, one a colour: in software, drawing
costs in proportion to the number of geoms, and the physics of a thread needs dozens.
"""

from __future__ import annotations

from functools import lru_cache

import mujoco
import numpy as np

from juicer.imaging.cameras import add_cameras
from juicer.imaging.look import Look
from juicer.imaging.parts import painted_surfaces
from juicer.imaging.surfaces import Surface
from juicer.sim.scene import build_spec
from juicer.tasks.registry import get_task
from juicer.tasks.specification import AssemblyTask, PartSpec

_NEAR_M, _FAR_M = 0.01, 6.0


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
    for part in task.parts:
        _add_part(spec, part)
    add_cameras(spec)
    _add_light(spec)
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


def _add_light(spec: mujoco.MjSpec) -> None:
    headlight = spec.visual.headlight
    headlight.ambient, headlight.diffuse, headlight.specular = (0.35,) * 3, (0.25,) * 3, (0.1,) * 3
    spec.worldbody.add_light(
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, pos=(0.3, 0, 2), dir=(-0.42, 0.13, -0.85), diffuse=(0.6,) * 3
    )


def _set_quality(spec: mujoco.MjSpec, look: Look) -> None:
    visual = spec.visual
    visual.quality.offsamples = look.samples
    visual.global_.offwidth, visual.global_.offheight = 1280, 720
    # Both are multiples of the scene's extent, which else depends on what is in it.
    spec.stat.extent = 1.0
    visual.map.znear, visual.map.zfar = _NEAR_M, _FAR_M
