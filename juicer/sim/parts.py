"""Collision geometry of a part: boxes, pegs, bores and true-contact helical threads from primitives.

Deviations from the measured geometry, each for a reason:

* An internal bead is a chain of capsules; its helix radius is enlarged by 1/cos(pi/n) so that the chords of the
  chain do not cut into the hole. An external bead is a row of spheres along the helix: a smooth chain against
  spheres gives the same flanks as chain against chain, at a fraction of the contacts.
* A peg is a capsule with a ring of small spheres around its flat tip. A bare hemisphere would let it lean.
* A bore is a ring of boxes, its inscribed circle the hole.
"""

from __future__ import annotations

import math
from itertools import pairwise

import mujoco
import numpy as np

from juicer.sim.contacts import BORE_WALL, HOLE_BEAD, PART, PEG, PEG_BEAD
from juicer.tasks.specification import Bore, PartSpec, Peg, Shell, Thread

HOLE_BEADS_PER_TURN = 16
PEG_BEADS_PER_TURN = 12
BORE_BOXES = 12
TIP_SPHERES = 8
TIP_SPHERE_RADIUS = 1.5e-3


def add_part(spec: mujoco.MjSpec, part: PartSpec) -> None:
    """Add a free body with the part's geometry and inertia."""
    body = spec.worldbody.add_body(
        name=part.name, mass=part.mass, ipos=part.center_of_mass, inertia=part.inertia, explicitinertial=True
    )
    body.add_freejoint(name=part.name)
    rgba = (*part.rgb, 1.0)
    for box in part.boxes:
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX, pos=box.center, size=box.half_size, quat=_turn(box.yaw_rad), rgba=rgba,
            **PART.attributes(),
        )  # fmt: skip
    for ball in part.balls:
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_SPHERE, pos=ball.center, size=(ball.radius, 0, 0), rgba=rgba,
            **PART.attributes(),
        )  # fmt: skip
    for shell in part.shells:
        _add_shell(body, shell, rgba)
    for peg in part.pegs:
        _add_peg(body, peg, rgba)
    for bore in part.bores:
        _add_bore(body, bore, rgba)
    for thread in part.threads:
        _add_thread(body, thread, rgba)


def _add_peg(body: mujoco.MjsBody, peg: Peg, rgba: tuple[float, ...]) -> None:
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=(peg.radius, 0, 0), rgba=rgba,
        fromto=(0, peg.tip_y + peg.radius, 0, 0, peg.root_y, 0), **PEG.attributes(),
    )  # fmt: skip
    ring = peg.radius - TIP_SPHERE_RADIUS
    for angle in np.arange(TIP_SPHERES) * 2 * math.pi / TIP_SPHERES:
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_SPHERE, size=(TIP_SPHERE_RADIUS, 0, 0), rgba=rgba,
            pos=(ring * math.sin(angle), peg.tip_y + TIP_SPHERE_RADIUS, ring * math.cos(angle)), **PEG.attributes(),
        )  # fmt: skip


def _turn(yaw_rad: float) -> tuple[float, float, float, float]:
    return (math.cos(yaw_rad / 2), 0.0, math.sin(yaw_rad / 2), 0.0)


def _add_shell(body: mujoco.MjsBody, shell: Shell, rgba: tuple[float, ...]) -> None:
    height, growth = shell.top_y - shell.bottom_y, shell.top_radius - shell.bottom_radius
    slope = math.atan2(growth, height)
    middle = (shell.bottom_radius + shell.top_radius) / 2 + shell.thickness / 2 / math.cos(slope)
    widest = max(shell.bottom_radius, shell.top_radius) + shell.thickness
    half_size = (widest * math.tan(math.pi / shell.panels), height / 2 / math.cos(slope), shell.thickness / 2)
    for angle in np.arange(shell.panels) * 2 * math.pi / shell.panels:
        # Turned about y to its place, then leant outwards about its own x axis.
        quat = np.empty(4)
        mujoco.mju_mulQuat(quat, np.array(_turn(angle)), np.array([math.cos(slope / 2), math.sin(slope / 2), 0, 0]))
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX, size=half_size, quat=quat, rgba=rgba,
            pos=(middle * math.sin(angle), (shell.bottom_y + shell.top_y) / 2, middle * math.cos(angle)),
            **PART.attributes(),
        )  # fmt: skip


def _add_bore(body: mujoco.MjsBody, bore: Bore, rgba: tuple[float, ...]) -> None:
    thickness = bore.outer_radius - bore.inner_radius
    middle = bore.inner_radius + thickness / 2
    half_width = bore.outer_radius * math.tan(math.pi / BORE_BOXES)
    center_y, half_y = (bore.bottom_y + bore.top_y) / 2, (bore.top_y - bore.bottom_y) / 2
    for angle in np.arange(BORE_BOXES) * 2 * math.pi / BORE_BOXES:
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX, size=(half_width, half_y, thickness / 2), rgba=rgba,
            pos=(bore.center_xz[0] + middle * math.sin(angle), center_y, bore.center_xz[1] + middle * math.cos(angle)),
            quat=_turn(angle), **BORE_WALL.attributes(),
        )  # fmt: skip


def helix_points(thread: Thread, per_turn: int, radius: float) -> np.ndarray:
    """Points ``(per_turn * turns + 1, 3)`` along a thread's centreline, in the part frame."""
    fraction = np.arange(round(per_turn * thread.turns) + 1) / per_turn
    azimuth = thread.start_azimuth_rad + 2 * math.pi * fraction
    x = thread.center_xz[0] + radius * np.sin(azimuth)
    z = thread.center_xz[1] + radius * np.cos(azimuth)
    return np.stack([x, thread.start_y + thread.pitch * fraction, z], axis=-1)


def _add_thread(body: mujoco.MjsBody, thread: Thread, rgba: tuple[float, ...]) -> None:
    size = (thread.bead_radius, 0, 0)
    if not thread.internal:
        for point in helix_points(thread, PEG_BEADS_PER_TURN, thread.helix_radius):
            body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=size, pos=point, rgba=rgba, **PEG_BEAD.attributes())
        return
    radius = thread.helix_radius / math.cos(math.pi / HOLE_BEADS_PER_TURN)
    points = helix_points(thread, HOLE_BEADS_PER_TURN, radius)
    for start, end in pairwise(points):
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=size, fromto=(*start, *end), rgba=rgba, **HOLE_BEAD.attributes()
        )
