"""Rigid transforms and rotation representations, vectorised over leading axes.

Quaternions are ``wxyz`` (MuJoCo's order) everywhere in juicer. ``rot6d`` is the first two *rows* of the
rotation matrix, flattened (Zhou et al. 2019, in the row convention of the original JUICER).
Poses are ``(..., 7)``: position in metres, then quaternion.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from juicer.errors import InvalidAction

Array = NDArray[np.floating[Any]]

SHORTEST_ROW = 1e-6
"""Length up to which a row of a 6D rotation counts as vanished."""


def normalised(vector: Array) -> Array:
    """Vectors ``(..., D)`` scaled to length one; a zero vector gives NaN."""
    unit: Array = vector / np.linalg.norm(vector, axis=-1, keepdims=True)
    return unit


def quat_multiply(left_wxyz: Array, right_wxyz: Array) -> Array:
    """Hamilton product ``(..., 4)``: rotate by ``right`` first, then by ``left``."""
    w1, x1, y1, z1 = np.moveaxis(np.asarray(left_wxyz), -1, 0)
    w2, x2, y2, z2 = np.moveaxis(np.asarray(right_wxyz), -1, 0)
    return np.stack(
        [
            w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2,
            w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2,
            w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2,
            w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2,
        ],
        axis=-1,
    )


def quat_conjugate(quat_wxyz: Array) -> Array:
    """Inverse rotation of unit quaternions ``(..., 4)``."""
    inverse: Array = np.asarray(quat_wxyz) * np.array([1.0, -1.0, -1.0, -1.0])
    return inverse


def quat_to_matrix(quat_wxyz: Array) -> Array:
    """Rotation matrices ``(..., 3, 3)`` of unit quaternions ``(..., 4)``."""
    w, x, y, z = np.moveaxis(np.asarray(quat_wxyz), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def matrix_to_quat(matrix: Array) -> Array:
    """Unit quaternions ``(..., 4)`` wxyz with ``w >= 0`` of rotation matrices ``(..., 3, 3)``."""
    matrix = np.asarray(matrix)
    m00, m11, m22 = matrix[..., 0, 0], matrix[..., 1, 1], matrix[..., 2, 2]
    # Each row is the quaternion scaled by one of its own components; the largest is best conditioned.
    scaled = np.stack(
        [
            np.stack(
                [
                    1 + m00 + m11 + m22,
                    matrix[..., 2, 1] - matrix[..., 1, 2],
                    matrix[..., 0, 2] - matrix[..., 2, 0],
                    matrix[..., 1, 0] - matrix[..., 0, 1],
                ],
                axis=-1,
            ),
            np.stack(
                [
                    matrix[..., 2, 1] - matrix[..., 1, 2],
                    1 + m00 - m11 - m22,
                    matrix[..., 1, 0] + matrix[..., 0, 1],
                    matrix[..., 0, 2] + matrix[..., 2, 0],
                ],
                axis=-1,
            ),
            np.stack(
                [
                    matrix[..., 0, 2] - matrix[..., 2, 0],
                    matrix[..., 1, 0] + matrix[..., 0, 1],
                    1 - m00 + m11 - m22,
                    matrix[..., 2, 1] + matrix[..., 1, 2],
                ],
                axis=-1,
            ),
            np.stack(
                [
                    matrix[..., 1, 0] - matrix[..., 0, 1],
                    matrix[..., 0, 2] + matrix[..., 2, 0],
                    matrix[..., 2, 1] + matrix[..., 1, 2],
                    1 - m00 - m11 + m22,
                ],
                axis=-1,
            ),
        ],
        axis=-2,
    )
    best = np.argmax(np.diagonal(scaled, axis1=-2, axis2=-1), axis=-1)
    quat = normalised(np.take_along_axis(scaled, best[..., None, None], axis=-2)[..., 0, :])
    return np.where(quat[..., :1] < 0, -quat, quat)


def matrix_to_rot6d(matrix: Array) -> Array:
    """First two rows ``(..., 6)`` of rotation matrices ``(..., 3, 3)``."""
    return np.asarray(matrix)[..., :2, :].reshape(*np.shape(matrix)[:-2], 6)


def rot6d_to_matrix(rot6d: Array) -> Array:
    """Rotation matrices ``(..., 3, 3)`` by Gram-Schmidt on the two rows in ``(..., 6)``.

    Raises:
        InvalidAction: If a row vanishes or both are parallel, so that no rotation is defined.
    """
    rows = np.asarray(rot6d, dtype=np.float64).reshape(*np.shape(rot6d)[:-1], 2, 3)
    first = _direction(rows[..., 0, :])
    along = np.vecdot(first, rows[..., 1, :])[..., None]
    second = _direction(rows[..., 1, :] - along * first)
    return np.stack([first, second, np.cross(first, second)], axis=-2)


def degenerate_rotation() -> InvalidAction:
    """The error of a 6D rotation whose rows do not span a plane."""
    return InvalidAction(
        "6D rotation is degenerate: a row vanishes or both are parallel; pass two rows of a rotation matrix"
    )


def _direction(row: Array) -> Array:
    length = np.linalg.norm(row, axis=-1, keepdims=True)
    if not length.min(initial=1.0) > SHORTEST_ROW:
        raise degenerate_rotation()
    direction: Array = row / length
    return direction


def rotvec_to_matrix(rotvec_rad: Array) -> Array:
    """Rotation matrices ``(..., 3, 3)`` of rotation vectors ``(..., 3)`` in radians (Rodrigues)."""
    rotvec_rad = np.asarray(rotvec_rad, dtype=np.float64)
    half = 0.5 * np.linalg.norm(rotvec_rad, axis=-1, keepdims=True)
    # sin(h)/(2h) written with numpy's sinc, which is defined at zero.
    quat = np.concatenate([np.cos(half), 0.5 * np.sinc(half / np.pi) * rotvec_rad], axis=-1)
    return quat_to_matrix(quat)


def matrix_to_rotvec(matrix: Array) -> Array:
    """Rotation vectors ``(..., 3)`` in radians, length at most pi, of matrices ``(..., 3, 3)``."""
    quat = matrix_to_quat(matrix)
    sine = np.linalg.norm(quat[..., 1:], axis=-1, keepdims=True)
    angle = 2 * np.arctan2(sine, quat[..., :1])
    rotvec: Array = quat[..., 1:] * np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 2.0)
    return rotvec


def rotation_angle(first: Array, second: Array) -> Array:
    """Angle in radians between rotation matrices ``(..., 3, 3)``."""
    relative = np.swapaxes(first, -1, -2) @ second
    angle: Array = np.linalg.norm(matrix_to_rotvec(relative), axis=-1)
    return angle


def axis_rotation(axis: str, angle_rad: float) -> Array:
    """Rotation matrix ``(3, 3)`` about the ``x``, ``y`` or ``z`` axis."""
    rotvec = np.zeros(3)
    rotvec["xyz".index(axis)] = angle_rad
    return rotvec_to_matrix(rotvec)


def relative_pose(reference: Array, pose: Array) -> Array:
    """Poses ``(..., 7)`` expressed in the frame of the reference poses ``(..., 7)``."""
    inverse = quat_conjugate(reference[..., 3:])
    offset = pose[..., :3] - reference[..., :3]
    position = (quat_to_matrix(inverse) @ offset[..., None])[..., 0]
    return np.concatenate([position, quat_multiply(inverse, pose[..., 3:])], axis=-1)
