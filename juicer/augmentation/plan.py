"""The way out of a critical state: pure geometry.

An end-effector pose is ``(9,)``: position (m, robot base frame) and rotation 6D, as in proprioception and actions.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from juicer.augmentation.config import DepartureConfig
from juicer.geometry import axis_rotation, matrix_to_rot6d, matrix_to_rotvec, rot6d_to_matrix, rotvec_to_matrix

POSE_SIZE = 9


def draw_kind(departures: Mapping[str, DepartureConfig], rng: np.random.Generator) -> str:
    """Name of a departure, drawn by weight."""
    names = sorted(departures)
    weights = np.array([departures[name].weight for name in names])
    return names[rng.choice(len(names), p=weights / weights.sum())]


def plan_departure(
    start: NDArray[np.floating[Any]], config: DepartureConfig, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Lift, move into a cone that opens upward, turn on the spot, and come down again.

    Args:
        start: End-effector pose ``(9,)`` at the critical state.
        config: Ranges to draw from.
        rng: Source of the draws.

    Returns:
        End-effector poses ``(K, 9)`` to aim at, one an action, the first one step away from the critical state.
    """
    position, rotation = np.asarray(start[:3], dtype=np.float64), rot6d_to_matrix(start[3:POSE_SIZE])
    up = np.array([0.0, 0.0, rng.uniform(*config.lift_m)])
    distance = rng.uniform(*config.distance_m)
    polar, azimuth = math.radians(rng.uniform(*config.polar_deg)), rng.uniform(0.0, 2 * math.pi)
    away = distance * np.array(
        [math.sin(polar) * math.cos(azimuth), math.sin(polar) * math.sin(azimuth), math.cos(polar)]
    )
    yaw_deg = config.rotation_deg if config.yaw_deg is None else config.yaw_deg
    bounds = np.radians([config.rotation_deg, config.rotation_deg, yaw_deg])
    roll, pitch, yaw = rng.uniform(-bounds, bounds)
    turn = matrix_to_rotvec(axis_rotation("z", yaw) @ axis_rotation("y", pitch) @ axis_rotation("x", roll))
    down = np.array([0.0, 0.0, -rng.uniform(*config.descent_m)])
    step_m, step_rad = rng.uniform(*config.step_m), math.radians(rng.uniform(*config.step_deg))

    lifted = position + up
    moved = lifted + away
    turned = rotation @ rotvec_to_matrix(turn)
    targets: NDArray[np.float64] = np.concatenate(
        [
            _poses(_shares(np.linalg.norm(up), step_m), position, up, rotation),
            _poses(_shares(distance, step_m), lifted, away, rotation),
            _turns(_shares(np.linalg.norm(turn), step_rad), moved, rotation, turn),
            _poses(_shares(np.linalg.norm(down), step_m), moved, down, turned),
        ]
    )
    return admissible(targets)


def admissible(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Poses ``(..., 9)`` as the environment takes them: the arm reaches 0.86 m, and entries beyond 1 are refused."""
    return poses.clip(-1.0, 1.0)


def reverse(achieved: NDArray[np.floating[Any]]) -> NDArray[np.floating[Any]]:
    """Targets that lead back: all poses but the last, which is where the way back begins, in reverse order.

    Args:
        achieved: End-effector poses ``(K + 1, 9)`` from the critical state to the end of the departure.
    """
    return achieved[-2::-1]


def _shares(length: float | np.floating[Any], step: float) -> NDArray[np.float64]:
    """Fractions of a way after each of its equal steps, none longer than ``step``; the last is 1."""
    count = math.ceil(float(length) / step - 1e-9)
    return np.arange(1, count + 1) / max(count, 1)


def _poses(
    shares: NDArray[np.float64],
    start: NDArray[np.float64],
    way: NDArray[np.float64],
    rotation: NDArray[np.floating[Any]],
) -> NDArray[np.float64]:
    rot6d = np.broadcast_to(matrix_to_rot6d(rotation), (len(shares), 6))
    return np.concatenate([start + shares[:, None] * way, rot6d], axis=1)


def _turns(
    shares: NDArray[np.float64],
    position: NDArray[np.float64],
    rotation: NDArray[np.floating[Any]],
    rotvec: NDArray[np.floating[Any]],
) -> NDArray[np.float64]:
    turned = rotation @ rotvec_to_matrix(shares[:, None] * rotvec)
    return np.concatenate([np.broadcast_to(position, (len(shares), 3)), matrix_to_rot6d(turned)], axis=1)
