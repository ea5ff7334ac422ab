"""How a part looks: a few surfaces, each of one colour, made from the specification that its physics is made from.

The small balls on which parts stand are left out: they are there for the contacts and stand out by 0.2 mm.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from juicer.imaging.surfaces import SEGMENTS, Painted, Surface, ball, box, outlined, ridge
from juicer.tasks.specification import Bore, Box, PartSpec, Peg, Shell, Vector

_SMALLEST_BALL_M = 0.005
_CHAMFER_M = 1.5e-3
_INSIDE_SHADE, _THREAD_SHADE = 0.35, 0.6
"""Brightness of the inside of holes and of threads, so that both can be told from what is around them."""
_LIFTED_M = 1e-4
"""A painted surface lies so far above the one it covers."""


def painted_surfaces(part: PartSpec) -> Iterator[Painted]:
    """All that is seen of a part, in its frame."""
    plain, inside, thread = part.rgb, _shaded(part.rgb, _INSIDE_SHADE), _shaded(part.rgb, _THREAD_SHADE)
    for shape in part.boxes:
        yield plain, box(shape)
    for sphere in part.balls:
        if sphere.radius > _SMALLEST_BALL_M:
            yield plain, ball(sphere)
    for shell in part.shells:
        yield plain, _shell(shell)
    for peg in part.pegs:
        yield plain, _peg(peg)
    for bore in part.bores:
        yield plain, _tube(bore)
        yield inside, _hole(bore, part.boxes)
    for bead in part.threads:
        yield thread, ridge(bead)
    for mark in part.marks:
        yield mark.rgb, box(mark.patch)


def _shaded(rgb: Vector, share: float) -> Vector:
    red, green, blue = (share * channel for channel in rgb)
    return red, green, blue


def _shell(shell: Shell) -> Surface:
    low_inner, high_inner = (shell.bottom_radius, shell.bottom_y), (shell.top_radius, shell.top_y)
    low_outer = (shell.bottom_radius + shell.thickness, shell.bottom_y)
    high_outer = (shell.top_radius + shell.thickness, shell.top_y)
    outline = (low_inner, low_outer, high_outer, high_inner, low_inner)
    return outlined(outline, 2 * SEGMENTS)


def _peg(peg: Peg) -> Surface:
    flat, chamfer_y = peg.radius - _CHAMFER_M, peg.tip_y + _CHAMFER_M
    return outlined(((0, peg.tip_y), (flat, peg.tip_y), (peg.radius, chamfer_y), (peg.radius, peg.root_y)))


def _tube(bore: Bore) -> Surface:
    """Its outside and both ends."""
    low_outer, high_outer = (bore.outer_radius, bore.bottom_y), (bore.outer_radius, bore.top_y)
    low_inner, high_inner = (bore.inner_radius, bore.bottom_y), (bore.inner_radius, bore.top_y)
    return outlined((low_inner, low_outer, high_outer, high_inner)).placed(_beside(bore))


def _hole(bore: Bore, boxes: tuple[Box, ...]) -> Surface:
    """Its inside, and where a box closes it, its ground."""
    radius = bore.inner_radius
    surfaces = [outlined(((radius, bore.top_y), (radius, bore.bottom_y)))]
    behind = [(y - half, y + half) for y, half in _crossing(bore.center_xz, boxes)]
    below = [high for _, high in behind if bore.bottom_y - _LIFTED_M < high < bore.top_y - _LIFTED_M]
    above = [low for low, _ in behind if bore.bottom_y + _LIFTED_M < low < bore.top_y + _LIFTED_M]
    if below:
        surfaces.append(outlined(((radius, max(below) + _LIFTED_M), (0, max(below) + _LIFTED_M))))
    elif above:
        surfaces.append(outlined(((0, min(above) - _LIFTED_M), (radius, min(above) - _LIFTED_M))))
    return Surface.joined(surfaces).placed(_beside(bore))


def _beside(bore: Bore) -> Vector:
    return (bore.center_xz[0], 0.0, bore.center_xz[1])


def _crossing(axis_xz: tuple[float, float], boxes: tuple[Box, ...]) -> Iterator[tuple[float, float]]:
    """Middle and half height of the boxes that an axis goes through."""
    for shape in boxes:
        x, z = axis_xz[0] - shape.center[0], axis_xz[1] - shape.center[2]
        cos, sin = math.cos(shape.yaw_rad), math.sin(shape.yaw_rad)
        if abs(cos * x - sin * z) < shape.half_size[0] and abs(sin * x + cos * z) < shape.half_size[2]:
            yield shape.center[1], shape.half_size[1]
