"""How robot, table and fence look: as the boxes, capsules and cylinders that their physics is made of."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from juicer.imaging.surfaces import Surface, box, capsule, outlined
from juicer.tasks.specification import Box

_PLANE_DEPTH = 0.01
_Y_TO_Z = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])


def primitive(geom: mujoco.MjsGeom) -> Surface:
    """Surface of a box, plane, capsule or cylinder, in the frame of the body that it belongs to."""
    position, rotation = np.array(geom.pos), _matrix(geom.quat)
    radius, half_length, _ = geom.size
    if not np.isnan(geom.fromto[0]):
        start, end = geom.fromto[:3], geom.fromto[3:]
        position, rotation = (start + end) / 2, _with_z_axis(end - start)
        half_length = float(np.linalg.norm(end - start)) / 2
    match geom.type:
        case mujoco.mjtGeom.mjGEOM_BOX:
            return box(Box((0, 0, 0), tuple(geom.size))).placed(position, rotation)
        case mujoco.mjtGeom.mjGEOM_PLANE:
            return box(Box((0, 0, -_PLANE_DEPTH), (*geom.size[:2], _PLANE_DEPTH))).placed(position, rotation)
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            return capsule(radius, half_length).placed(position, rotation @ _Y_TO_Z)
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            outline = ((0, -half_length), (radius, -half_length), (radius, half_length), (0, half_length))
            return outlined(outline).placed(position, rotation @ _Y_TO_Z)
    raise NotImplementedError(f"nothing draws a geom of type {geom.type}")


def _matrix(quat: NDArray[np.float64]) -> NDArray[np.float64]:
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, quat)
    return matrix.reshape(3, 3)


def _with_z_axis(axis: NDArray[np.float64]) -> NDArray[np.float64]:
    quat = np.empty(4)
    mujoco.mju_quatZ2Vec(quat, axis / np.linalg.norm(axis))
    return _matrix(quat)
