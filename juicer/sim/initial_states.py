"""Where the parts lie when an episode begins (FurnitureBench's randomness levels)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from juicer.geometry import quat_multiply
from juicer.sim.scene import FENCE
from juicer.tasks.specification import AssemblyTask, PartSpec, Randomness

_SPREAD = {Randomness.LOW: (0.015, math.radians(15)), Randomness.MED: (0.05, math.radians(45))}
# Part origins stay inside this rectangle of the robot base frame (x, y) [m].
_REGION = np.array([[0.3715, -0.21], [0.6715, 0.21]])
_MARGIN_M = 0.01
_MAX_DRAWS = 300_000


def initial_part_poses(task: AssemblyTask, randomness: Randomness, rng: np.random.Generator) -> NDArray[np.float64]:
    """Poses ``(P, 7)`` of the parts in the robot base frame, quaternion wxyz.

    Low and medium randomness move and turn every part independently, and draw again until no footprints overlap;
    high randomness picks one of the stored layouts.
    """
    if randomness is Randomness.HIGH:
        layout = task.high_layouts[int(rng.integers(len(task.high_layouts)))]
        return np.array([layout[part.name] for part in task.parts])
    means = np.array([part.start for part in task.parts])
    reach_m, reach_rad = _SPREAD[randomness]
    for _ in range(_MAX_DRAWS):
        shift = rng.uniform(-reach_m, reach_m, (len(means), 2))
        yaw = rng.uniform(-reach_rad, reach_rad, len(means))
        positions = means[:, :2] + shift
        inside = (positions >= _REGION[0] - 1e-9) & (positions <= _REGION[1] + 1e-9)
        if inside.all() and not _overlaps(task.parts, positions, yaw):
            break
    else:
        raise RuntimeError(f"no free layout of {task.name} at {randomness} randomness in {_MAX_DRAWS} draws")
    poses = means.copy()
    poses[:, :2] = positions
    turn = np.stack([np.cos(yaw / 2), 0 * yaw, 0 * yaw, np.sin(yaw / 2)], axis=-1)
    poses[:, 3:] = quat_multiply(turn, means[:, 3:])
    return poses


def _overlaps(parts: tuple[PartSpec, ...], positions: NDArray[np.float64], yaw: NDArray[np.float64]) -> bool:
    """Whether axis-aligned boxes of the turned footprints overlap, with a margin, one another or the fence."""
    half = np.array([part.footprint for part in parts]) / 2
    cosine, sine = np.abs(np.cos(yaw)), np.abs(np.sin(yaw))
    reach = np.stack([half[:, 0] * cosine + half[:, 1] * sine, half[:, 0] * sine + half[:, 1] * cosine], axis=-1)
    reach += _MARGIN_M / 2
    centers = np.concatenate([positions, [center for center, _ in FENCE]])
    reaches = np.concatenate([reach, [extent for _, extent in FENCE]])
    distance = np.abs(centers[:, None] - centers[None])
    touching = (distance < reaches[:, None] + reaches[None]).all(axis=-1)
    touching[len(parts) :, len(parts) :] = False
    return bool(np.triu(touching, k=1).any())
