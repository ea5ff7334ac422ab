"""How far two bodies are from touching each other."""

from __future__ import annotations

import mujoco
import numpy as np


def clearance_m(model: mujoco.MjModel, data: mujoco.MjData, first: str, second: str, limit_m: float) -> float:
    """Smallest distance between two bodies' surfaces that can collide, at most ``limit_m``; negative if they overlap.

    Args:
        model: The scene.
        data: Its present state, with positions up to date.
        first: Name of a body.
        second: Name of another body.
        limit_m: Distances beyond it are not told apart.
    """
    left, right = _geoms(model, first), _geoms(model, second)
    between = np.linalg.norm(data.geom_xpos[left][:, None] - data.geom_xpos[right][None], axis=2)
    # Bounding spheres first: nearly all pairs of a hundred beads are far apart.
    near = between - model.geom_rbound[left][:, None] - model.geom_rbound[right][None] < limit_m
    collide = (model.geom_contype[left][:, None] & model.geom_conaffinity[right][None]) | (
        model.geom_conaffinity[left][:, None] & model.geom_contype[right][None]
    )
    smallest = limit_m
    for row, column in np.argwhere(near & (collide != 0)):
        smallest = min(smallest, mujoco.mj_geomDistance(model, data, left[row], right[column], smallest, None))
    return smallest


def _geoms(model: mujoco.MjModel, body: str) -> np.ndarray:
    owner = model.body(body)
    return np.arange(owner.geomadr[0], owner.geomadr[0] + owner.geomnum[0])
