"""Rotations in torch, for what is computed in batches while training; conventions of :mod:`juicer.geometry`."""

from __future__ import annotations

import torch
from torch import Tensor

SMALLEST_LENGTH = 1e-6
"""Predicted 6D rotations may be degenerate; a floor keeps them finite where geometry would raise."""


def quat_to_matrix(quat_wxyz: Tensor) -> Tensor:
    """Rotation matrices ``(..., 3, 3)`` of unit quaternions ``(..., 4)``."""
    w, x, y, z = quat_wxyz.unbind(-1)
    entries = [
        1 - 2 * (y * y + z * z),
        2 * (x * y - w * z),
        2 * (x * z + w * y),
        2 * (x * y + w * z),
        1 - 2 * (x * x + z * z),
        2 * (y * z - w * x),
        2 * (x * z - w * y),
        2 * (y * z + w * x),
        1 - 2 * (x * x + y * y),
    ]
    return torch.stack(entries, dim=-1).reshape(*quat_wxyz.shape[:-1], 3, 3)


def rot6d_to_matrix(rot6d: Tensor) -> Tensor:
    """Rotation matrices ``(..., 3, 3)`` by Gram-Schmidt on the two rows in ``(..., 6)``."""
    first, second = rot6d[..., :3], rot6d[..., 3:]
    first = first / first.norm(dim=-1, keepdim=True).clamp_min(SMALLEST_LENGTH)
    second = second - (first * second).sum(-1, keepdim=True) * first
    second = second / second.norm(dim=-1, keepdim=True).clamp_min(SMALLEST_LENGTH)
    return torch.stack([first, second, torch.linalg.cross(first, second)], dim=-2)


def matrix_to_rot6d(matrix: Tensor) -> Tensor:
    """First two rows ``(..., 6)`` of rotation matrices ``(..., 3, 3)``."""
    return matrix[..., :2, :].flatten(-2)


def euler_xyz_to_matrix(angles_rad: Tensor) -> Tensor:
    """``Rx(a) Ry(b) Rz(c)``, shape ``(..., 3, 3)``, of angles ``(..., 3)``."""
    (ca, cb, cc), (sa, sb, sc) = angles_rad.cos().unbind(-1), angles_rad.sin().unbind(-1)
    entries = [
        cb * cc,
        -cb * sc,
        sb,
        ca * sc + sa * sb * cc,
        ca * cc - sa * sb * sc,
        -sa * cb,
        sa * sc - ca * sb * cc,
        sa * cc + ca * sb * sc,
        ca * cb,
    ]
    return torch.stack(entries, dim=-1).reshape(*angles_rad.shape[:-1], 3, 3)


def rotate_back(matrix: Tensor, vector: Tensor) -> Tensor:
    """``matrix^T vector``: base-frame vectors ``(..., 3)`` seen in the frame of ``matrix`` ``(..., 3, 3)``."""
    return (matrix * vector.unsqueeze(-1)).sum(-2)


def twist_about_y(matrix: Tensor) -> Tensor:
    """Sine and cosine ``(..., 2)`` of the rotation about the y axis (swing-twist decomposition)."""
    cosine = matrix[..., 2, 2] + matrix[..., 0, 0]
    sine = matrix[..., 0, 2] - matrix[..., 2, 0]
    # Both vanish only for a part turned upside down, where the twist is undefined.
    return torch.stack([sine, cosine], dim=-1) / torch.hypot(sine, cosine).clamp_min(1e-6).unsqueeze(-1)
