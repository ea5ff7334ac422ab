"""Where the parts lie when an episode begins (FurnitureBench's randomness levels)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from juicer.geometry import quat_multiply
from juicer.shifts import Outside, Shift
from juicer.sim.scene import FENCE
from juicer.tasks.specification import AssemblyTask, PartSpec, Randomness

_SPREAD = {Randomness.LOW: (0.015, math.radians(15)), Randomness.MED: (0.05, math.radians(45))}
# Part origins stay inside this rectangle of the robot base frame (x, y) [m].
_REGION = np.array([[0.3715, -0.21], [0.6715, 0.21]])
_MARGIN_M = 0.01
_MAX_DRAWS, _DRAWS_AT_ONCE = 300_000, 250


def initial_part_poses(
    task: AssemblyTask, randomness: Randomness, rng: np.random.Generator, shift: Shift | None = None
) -> NDArray[np.float64]:
    """Poses ``(P, 7)`` of the parts in the robot base frame, quaternion wxyz.

    Low and medium randomness move and turn every part independently, and draw again until no footprints overlap;
    high randomness picks one of the stored layouts.

    Args:
        task: Whose parts they are.
        randomness: How far they may stray.
        rng: Random numbers of the episode.
        shift: If it is one that leads outside, a part that is to be assembled starts outside the region of this
            randomness.
    """
    if randomness is Randomness.HIGH:
        return np.array(task.high_layouts[int(rng.integers(len(task.high_layouts)))])
    positions, yaw = _free_layout(task, randomness, rng, shift if isinstance(shift, Outside) else None)
    poses = np.array([part.start for part in task.parts])
    turn = np.stack([np.cos(yaw / 2), 0 * yaw, 0 * yaw, np.sin(yaw / 2)], axis=-1)
    poses[:, :2] = positions
    poses[:, 3:] = quat_multiply(turn, poses[:, 3:])
    return poses


def _free_layout(
    task: AssemblyTask, randomness: Randomness, rng: np.random.Generator, outside: Outside | None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Positions ``(P, 2)`` and turns ``(P,)``: the first draw in which all parts are in the region and none overlap."""
    num_parts = len(task.parts)
    means = np.array([part.start[:2] for part in task.parts])
    reach_m, reach_rad = _SPREAD[randomness]
    lowest, highest = np.array([part.start_shift_m or (-reach_m, reach_m) for part in task.parts]).T[:, :, None]
    for _ in range(0, _MAX_DRAWS, _DRAWS_AT_ONCE):
        draws = rng.random((_DRAWS_AT_ONCE, 3 * num_parts))
        shifts = lowest + (highest - lowest) * draws[:, : 2 * num_parts].reshape(-1, num_parts, 2)
        yaws = -reach_rad + 2 * reach_rad * draws[:, 2 * num_parts :]
        astray = np.ones(_DRAWS_AT_ONCE, bool)
        if outside:
            # Another part in each draw: for some of them there may be no room.
            chosen = rng.choice(task.assembled_parts, _DRAWS_AT_ONCE)[:, None] == np.arange(num_parts)
            middle = (lowest + highest) / 2
            shifts = np.where(chosen[..., None], middle + outside.wider * (shifts - middle), shifts)
            yaws = np.where(chosen, outside.wider * yaws, yaws)
            astray = ((shifts < lowest) | (shifts > highest)).any(axis=(1, 2)) | (np.abs(yaws) > reach_rad).any(axis=1)
        positions = means + shifts
        inside = astray & ((positions >= _REGION[0] - 1e-9) & (positions <= _REGION[1] + 1e-9)).all(axis=(1, 2))
        positions, yaws = positions[inside], yaws[inside]
        free = np.flatnonzero(~_overlaps(task.parts, positions, yaws))
        if len(free):
            return positions[free[0]], yaws[free[0]]
    raise RuntimeError(f"no free layout of {task.name} at {randomness} randomness in {_MAX_DRAWS} draws")


def _overlaps(
    parts: tuple[PartSpec, ...], positions: NDArray[np.float64], yaw: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """In which layouts footprints overlap, with a margin, one another or the fence.

    A rectangle counts as the axis-aligned box around it when turned, a disc as itself.

    Args:
        parts: The ``P`` parts.
        positions: ``(N, P, 2)`` [m].
        yaw: ``(N, P)`` [rad].
    """
    count = len(positions)
    radius = np.array([part.footprint[0] / 2 if part.is_round else 0.0 for part in parts] + [0.0] * len(FENCE))
    half = np.array([(0.0, 0.0) if part.is_round else part.footprint for part in parts]) / 2
    cosine, sine = np.abs(np.cos(yaw)), np.abs(np.sin(yaw))
    reach = np.stack([half[:, 0] * cosine + half[:, 1] * sine, half[:, 0] * sine + half[:, 1] * cosine], axis=-1)
    fence = np.broadcast_to(FENCE, (count, *np.shape(FENCE)))
    centers = np.concatenate([positions, fence[:, :, 0]], axis=1)
    reaches = np.concatenate([reach + _MARGIN_M / 2, fence[:, :, 1]], axis=1)
    gap = np.abs(centers[:, :, None] - centers[:, None]) - (reaches[:, :, None] + reaches[:, None])
    boxes_touch = (gap < 0).all(axis=-1)
    discs_touch = np.linalg.norm(gap.clip(min=0), axis=-1) < radius[:, None] + radius[None]
    touching = boxes_touch | discs_touch
    touching[:, len(parts) :, len(parts) :] = False
    overlapping: NDArray[np.bool_] = np.triu(touching, k=1).any(axis=(1, 2))
    return overlapping
