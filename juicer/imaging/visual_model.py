"""What of a scene is seen, as a MuJoCo model of its own: the same bodies and joints as in the physics, other geometry.

It has the simulated model's ``qpos`` and is drawn from that alone. Nothing in it collides or moves by itself, so what
is drawn can be changed without changing any result. Every body is a few meshes, one a colour: in software, drawing
costs in proportion to the number of geoms, and the physics of a thread needs dozens.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import lru_cache

import mujoco
import numpy as np

from juicer.imaging.cameras import add_cameras
from juicer.imaging.look import Look
from juicer.imaging.panda_mesh import add_panda_mesh, is_of_robot, unreadable_panda_mesh
from juicer.imaging.parts import painted_surfaces
from juicer.imaging.primitives import primitive
from juicer.imaging.surfaces import Painted, Surface, box
from juicer.sim.scene import build_spec
from juicer.tasks.registry import get_task
from juicer.tasks.specification import AssemblyTask, Box, Vector

_NEAR_M, _FAR_M = 0.01, 6.0
_SHADOW_REACH_M = 0.45
_WALL_YAW_RAD = math.radians(20.4)
_WALL_RGB = (0.0, 0.45, 0.27)
_WORLD = "world"
_LAYER_M = 3e-6
"""Surfaces of a body overlap; each stands out by this over the one before, so that it is decided which is seen."""


@lru_cache(maxsize=8)
def visual_model(task_name: str, look: Look) -> mujoco.MjModel:
    """Model of a task to be drawn, compiled once a process.

    Raises:
        ConfigError: If there is no such task, or the robot's mesh is asked for and not installed or damaged.
    """
    spec = visual_spec(get_task(task_name), look)
    try:
        return spec.compile()
    except ValueError as error:
        if look.robot != "mesh":
            raise
        raise unreadable_panda_mesh(error) from None


def visual_spec(task: AssemblyTask, look: Look) -> mujoco.MjSpec:
    """The same, not compiled."""
    spec = build_spec(task)
    has_mesh = look.robot == "mesh"
    bodies: dict[str, list[Painted]] = {part.name: list(painted_surfaces(part)) for part in task.parts}
    bodies[_WORLD] = list(_walls())
    parts = {part.name for part in task.parts}
    for geom in list(spec.geoms):
        body = geom.parent.name
        if body not in parts and not (has_mesh and is_of_robot(geom)):
            red, green, blue, _ = geom.rgba.tolist()
            bodies.setdefault(body, []).append(((red, green, blue), primitive(geom)))
        spec.delete(geom)
    for body, surfaces in bodies.items():
        _add_meshes(spec, body, surfaces)
    if has_mesh:
        add_panda_mesh(spec)
    add_cameras(spec)
    _add_light(spec, look)
    _set_quality(spec, look)
    return spec


def _add_meshes(spec: mujoco.MjSpec, body: str, painted: Sequence[Painted]) -> None:
    """A mesh a colour. A texture with all colours would make it one a body, but costs more than it saves."""
    by_colour: dict[Vector, list[Surface]] = {}
    for number, (colour, surface) in enumerate(painted):
        by_colour.setdefault(colour, []).append(surface.grown(number * _LAYER_M))
    for number, (colour, surfaces) in enumerate(by_colour.items()):
        name, whole = f"{body}_{number}", Surface.joined(surfaces)
        faces = whole.faces.astype(np.int32).ravel()
        # Most are not closed, so they have no volume of which to compute an inertia.
        spec.add_mesh(
            name=name, uservert=whole.vertices.ravel(), userface=faces, usernormal=whole.normals.ravel(),
            userfacenormal=faces, inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
        )  # fmt: skip
        spec.body(body).add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, rgba=(*colour, 1.0), contype=0, conaffinity=0
        )


def _walls() -> Iterator[Painted]:
    """FurnitureBench's green walls beside the one behind the robot, which slant away from it."""
    for side in (1, -1):
        cos, sin = math.cos(_WALL_YAW_RAD), side * math.sin(_WALL_YAW_RAD)
        rotation = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
        wall = box(Box((0, 0, 0), (0.747, 0.005, 0.75)))
        yield _WALL_RGB, wall.placed((0.2, 0.95 * side, 0.32), rotation)


def _add_light(spec: mujoco.MjSpec, look: Look) -> None:
    """A lamp above the front, and some light from everywhere: more of it where things cast shadows."""
    from_everywhere, from_the_lamp, gloss = (0.7, 0.42, 0.25) if look.for_people else (0.5, 0.55, 0.0)
    headlight = spec.visual.headlight
    headlight.ambient, headlight.diffuse = (0.65 * from_everywhere,) * 3, (0.35 * from_everywhere,) * 3
    headlight.specular = (0.0,) * 3
    spec.worldbody.add_light(
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, pos=(1.1, -0.07, 1.2), dir=(-0.42, 0.05, -0.85),
        diffuse=(from_the_lamp,) * 3, specular=(gloss,) * 3,
    )  # fmt: skip


def _set_quality(spec: mujoco.MjSpec, look: Look) -> None:
    visual = spec.visual
    visual.quality.offsamples = look.samples
    # Larger ones cost more than all the rest.
    visual.quality.shadowsize = 1024
    # The buffer grows with what is drawn: one that is larger costs time.
    visual.global_.offwidth, visual.global_.offheight = 1, 1
    # These are multiples of the scene's extent, which else depends on what is in it.
    spec.stat.extent = 1.0
    visual.map.znear, visual.map.zfar = _NEAR_M, _FAR_M
    visual.map.shadowclip = _SHADOW_REACH_M
