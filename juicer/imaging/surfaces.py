"""Closed and open surfaces as triangles with normals, from which the visible shape of a part is put together.

All are in the part's frame, whose y axis is the axis of everything round. A face is seen from the side from which its
corners run counterclockwise.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from juicer.tasks.specification import Ball, Box, Thread, Vector

Array = NDArray[np.float64]

SEGMENTS = 20
"""Straight pieces of a turn around a peg or a hole; wide rings take twice as many."""
_UNTURNED = np.eye(3)
_BEAD_SEGMENTS = 4
_BEAD_HALF_ARC = math.radians(100)
"""Of a bead's round section, what can stand out of the wall on which it lies."""


@dataclass(frozen=True)
class Surface:
    """Triangles that one geom draws.

    Attributes:
        vertices: Their corners ``(V, 3)`` [m].
        normals: Unit vectors away from the surface there ``(V, 3)``.
        faces: Three indices of corners a triangle ``(F, 3)``.
    """

    vertices: Array
    normals: Array
    faces: NDArray[np.int64]

    @classmethod
    def joined(cls, surfaces: Iterable[Surface]) -> Surface:
        """Several as one."""
        surfaces = list(surfaces)
        starts = np.cumsum([0, *(len(each.vertices) for each in surfaces[:-1])])
        return cls(
            np.concatenate([each.vertices for each in surfaces]),
            np.concatenate([each.normals for each in surfaces]),
            np.concatenate([each.faces + start for each, start in zip(surfaces, starts, strict=True)]),
        )

    def grown(self, margin: float) -> Surface:
        """Every point moved along its normal."""
        return Surface(self.vertices + margin * self.normals, self.normals, self.faces)

    def placed(self, position: ArrayLike, rotation: ArrayLike = _UNTURNED) -> Surface:
        """Turned by a rotation matrix, then moved."""
        turn = np.asarray(rotation, float).T
        return Surface(self.vertices @ turn + np.asarray(position, float), self.normals @ turn, self.faces)


Painted = tuple[Vector, Surface]
"""A surface and its colour, each channel in [0, 1]."""


def box(shape: Box) -> Surface:
    """The six faces of a box."""
    faces = []
    for axis in range(3):
        for sign in (1, -1):
            normal, across = np.zeros(3), np.zeros(3)
            normal[axis], across[(axis + 1) % 3] = sign, 1
            up = np.cross(normal, across)
            corners = [normal - across - up, normal + across - up, normal + across + up, normal - across + up]
            faces.append(Surface(np.array(corners) * shape.half_size, np.tile(normal, (4, 1)), _quad()))
    return Surface.joined(faces).placed(shape.center, yaw_matrix(shape.yaw_rad))


def ball(shape: Ball, segments: int = 2 * SEGMENTS) -> Surface:
    """A whole sphere."""
    return capsule(shape.radius, 0.0, segments).placed(shape.center)


def capsule(radius: float, half_length: float, segments: int = SEGMENTS) -> Surface:
    """Cylinder along the y axis with half spheres at its ends."""
    angles = np.linspace(0, math.pi / 2, segments // 5 + 1)
    upper = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    normals = np.concatenate([upper[::-1] * (1, -1), upper])
    heights = np.repeat([-half_length, half_length], len(upper))
    return revolved(radius * normals + np.stack([0 * heights, heights], axis=1), normals, segments)


def outlined(outline: Sequence[tuple[float, float]], segments: int = SEGMENTS) -> Surface:
    """What an outline of radii and heights sweeps around the y axis, seen from the side on its right."""
    return Surface.joined(_cone_wall(start, end, segments) for start, end in pairwise(outline))


def revolved(profile: ArrayLike, normals: ArrayLike, segments: int = SEGMENTS) -> Surface:
    """Smooth surface around the y axis, seen from outside if its profile rises.

    Args:
        profile: Radius and height of its points ``(P, 2)``.
        normals: Away from the axis and up ``(P, 2)``.
        segments: Straight pieces of a turn.
    """
    radius, height = np.asarray(profile, float).T
    outwards, up = np.asarray(normals, float).T
    angle = np.linspace(0, 2 * math.pi, segments + 1)[:, None]
    sin, cos, flat = np.sin(angle), np.cos(angle), np.ones_like(angle)
    vertices = np.stack([radius * sin, height * flat, radius * cos], axis=-1)
    directions = np.stack([outwards * sin, up * flat, outwards * cos], axis=-1)
    return _grid(vertices, directions)


def _cone_wall(bottom: tuple[float, float], top: tuple[float, float], segments: int = SEGMENTS) -> Surface:
    """Wall between two circles, each given by radius and height, seen from outside if it rises, else from inside."""
    (low_radius, low), (high_radius, high) = bottom, top
    normal = np.array([high - low, low_radius - high_radius]) / math.hypot(high - low, low_radius - high_radius)
    return revolved([bottom, top], [normal, normal], segments)


def ridge(thread: Thread) -> Surface:
    """The bead of a thread as a smooth helical ridge with flat ends."""
    outwards = -1.0 if thread.internal else 1.0
    arc = np.linspace(-_BEAD_HALF_ARC, _BEAD_HALF_ARC, _BEAD_SEGMENTS + 1)
    section = np.stack([outwards * np.cos(arc), outwards * np.sin(arc)], axis=1)
    turn = np.linspace(0, thread.turns, round(SEGMENTS * thread.turns) + 1)[:, None]
    angle = thread.start_azimuth_rad + 2 * math.pi * turn
    sin, cos = np.sin(angle), np.cos(angle)
    out, up = section.T

    def around(radial: Array, vertical: Array) -> Array:
        return np.stack([radial * sin, np.broadcast_to(vertical, np.shape(radial * sin)), radial * cos], axis=-1)

    middle = thread.start_y + thread.pitch * turn
    points = around(thread.helix_radius + thread.bead_radius * out, middle + thread.bead_radius * up)
    x, z = thread.center_xz
    ends = (_fan(points[0, ::-1]), _fan(points[-1]))
    return Surface.joined([_grid(points, around(out, up)), *ends]).placed((x, 0, z))


def _grid(vertices: Array, normals: Array) -> Surface:
    """Quads between neighbours of ``(N, M, 3)`` points, seen from the side where the second axis runs up."""
    rows, columns = vertices.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    here, right = index[:-1, :-1].ravel(), index[1:, :-1].ravel()
    above, across = index[:-1, 1:].ravel(), index[1:, 1:].ravel()
    faces = np.concatenate([np.stack([here, right, across], axis=1), np.stack([here, across, above], axis=1)])
    vertices, normals = vertices.reshape(-1, 3), normals.reshape(-1, 3)
    # At a pole, one of the two triangles has no area.
    edges = vertices[faces[:, 1:]] - vertices[faces[:, :1]]
    has_area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) > 1e-14
    return Surface(vertices, normals, faces[has_area])


def _fan(points: Array) -> Surface:
    """Flat polygon."""
    normal = np.cross(points[1] - points[0], points[2] - points[0])
    numbers = np.arange(1, len(points) - 1)
    faces = np.stack([np.zeros_like(numbers), numbers, numbers + 1], axis=1)
    return Surface(points, np.tile(normal / np.linalg.norm(normal), (len(points), 1)), faces)


def yaw_matrix(yaw_rad: float) -> Array:
    """Turn about the y axis."""
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]])


def _quad() -> NDArray[np.int64]:
    return np.array([[0, 1, 2], [0, 2, 3]])
