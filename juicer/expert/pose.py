"""Single poses as small arrays.

:mod:`juicer.geometry` is vectorised over leading axes; on one pose its general functions cost twenty times as much
as these, and an operator needs a dozen at every control step.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
"""Three numbers: a position [m], a direction or a rotation vector [rad], in the robot base frame."""

Matrix = NDArray[np.float64]
"""Rotation matrix ``(3, 3)``."""

UP: Vector = np.array([0.0, 0.0, 1.0])
"""Away from the table."""


@dataclass(frozen=True)
class Pose:
    """Where something is and how it is turned: its frame's origin [m] and axes (the columns)."""

    position: Vector
    rotation: Matrix

    def __matmul__(self, other: Pose) -> Pose:
        """Pose of something that ``other`` gives in this frame."""
        return Pose(self.position + self.rotation @ other.position, self.rotation @ other.rotation)

    def inverse(self) -> Pose:
        """Pose of the surrounding frame in this one."""
        back = self.rotation.T
        return Pose(-(back @ self.position), back)


def pose_of(values: Sequence[float]) -> Pose:
    """Pose of seven numbers: position [m], unit quaternion wxyz."""
    x, y, z, qw, qx, qy, qz = (float(value) for value in values)
    rotation = np.array(
        [
            [1 - 2 * (qy * qy + qz * qz), 2 * (qx * qy - qw * qz), 2 * (qx * qz + qw * qy)],
            [2 * (qx * qy + qw * qz), 1 - 2 * (qx * qx + qz * qz), 2 * (qy * qz - qw * qx)],
            [2 * (qx * qz - qw * qy), 2 * (qy * qz + qw * qx), 1 - 2 * (qx * qx + qy * qy)],
        ]
    )
    return Pose(np.array([x, y, z]), rotation)


def matrix_of_rows(rot6d: NDArray[np.floating[Any]]) -> Matrix:
    """Rotation of six numbers, the first two rows of its matrix, which must be orthonormal."""
    first, second = np.asarray(rot6d[:3], np.float64), np.asarray(rot6d[3:6], np.float64)
    return np.array([first, second, cross(first, second)])


def cross(first: Vector, second: Vector) -> Vector:
    """Vector product; ``numpy.cross`` takes ten times as long on three numbers."""
    a, b, c = first.tolist()
    x, y, z = second.tolist()
    return np.array([b * z - c * y, c * x - a * z, a * y - b * x])


def length(vector: Vector) -> float:
    """Euclidean length."""
    return math.sqrt(float(vector @ vector))


def shortened(vector: Vector, longest: float) -> Vector:
    """The vector, scaled down to the length ``longest`` if it is longer."""
    size = length(vector)
    return vector if size <= longest else vector * (longest / size)


def turn_between(start: Matrix, goal: Matrix) -> Vector:
    """Rotation vector in the base frame, at most pi long, that turns ``start`` into ``goal`` [rad]."""
    (m00, m01, m02), (m10, m11, m12), (m20, m21, m22) = (goal @ start.T).tolist()
    axis = np.array([m21 - m12, m02 - m20, m10 - m01])
    sine, cosine = 0.5 * length(axis), 0.5 * (m00 + m11 + m22 - 1.0)
    angle = math.atan2(sine, cosine)
    if sine > 1e-6:
        return axis * (0.5 * angle / sine)
    if cosine > 0:
        return 0.5 * axis
    # Half a turn: the axis is the dominant column of (R + 1) / 2 and its sign is free.
    symmetric = np.array([[m00 + 1, m01, m02], [m10, m11 + 1, m12], [m20, m21, m22 + 1]])
    column = symmetric[:, int(np.argmax(np.diagonal(symmetric)))]
    return column * (angle / length(column))


def turned(turn: Vector, rotation: Matrix) -> Matrix:
    """``rotation``, turned by a rotation vector [rad] of the base frame."""
    angle = length(turn)
    if angle < 1e-9:
        return rotation
    x, y, z = (turn / angle).tolist()
    s, c = math.sin(angle), math.cos(angle)
    d = 1.0 - c
    matrix = np.array(
        [
            [c + d * x * x, d * x * y - s * z, d * x * z + s * y],
            [d * x * y + s * z, c + d * y * y, d * y * z - s * x],
            [d * x * z - s * y, d * y * z + s * x, c + d * z * z],
        ]
    )
    turned_rotation: Matrix = matrix @ rotation
    return turned_rotation


def swing(start: Vector, goal: Vector) -> Vector:
    """Rotation vector [rad] that takes one unit vector to another the shortest way; none if they are opposite."""
    across = cross(start, goal)
    sine = length(across)
    if sine < 1e-9:
        return across
    swung: Vector = math.atan2(sine, float(start @ goal)) / sine * across
    return swung


def angle_between(first: Vector, second: Vector) -> float:
    """Angle between two unit vectors [rad]."""
    return math.acos(min(1.0, max(-1.0, float(first @ second))))


def heading(direction: Vector) -> float:
    """Angle of a direction's horizontal part about the vertical, zero forwards, positive to the left [rad]."""
    return math.atan2(float(direction[1]), float(direction[0]))


def wrapped(angle: float, period: float = 2 * math.pi) -> float:
    """The angle plus a multiple of the period, in [-period/2, period/2)."""
    return (angle + 0.5 * period) % period - 0.5 * period
