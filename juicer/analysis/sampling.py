"""Samples of an action at one state, and how far two sets of them are apart (Fig. 4 of the paper)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from juicer.geometry import rot6d_to_matrix
from juicer.storage.analyses import DIMENSIONS

SLICED = "sliced"
"""Among distances by dimension: that of all dimensions together."""
CHANCE = "chance"
"""Among distances by numbers of steps: that of a second set in as many steps as the reference."""
DIRECTIONS = 200
"""Random directions of the sliced distance."""
FLOORS = np.array([0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.01])
"""Least standard deviation by which a dimension is divided: what spreads less makes no difference to a robot."""

Samples = NDArray[np.float64]


def changes(actions: NDArray[np.floating], proprioception: NDArray[np.floating]) -> Samples:
    """What absolute actions ``(n, 10)`` change of the present pose: ``(n, 7)``, see :data:`DIMENSIONS`.

    Args:
        actions: Targets in the robot base frame.
        proprioception: ``(16,)`` of the same state.
    """
    from scipy.spatial.transform import Rotation  # takes long to import

    moved_mm = 1000 * (actions[:, :3] - proprioception[:3])
    turned = rot6d_to_matrix(actions[:, 3:9]) @ rot6d_to_matrix(proprioception[3:9]).T
    angles = Rotation.from_matrix(turned).as_euler("xyz", degrees=True)
    return np.concatenate([moved_mm, angles, actions[:, 9:]], axis=1).astype(np.float64)


def distances(samples: Samples, reference: Samples, rng: np.random.Generator) -> Mapping[str, float]:
    """How far samples ``(n, 7)`` are from a reference ``(n, 7)``: Wasserstein distances of first order.

    By name of the dimension, in its unit; and as ``sliced`` that of all together, the mean over random directions, each
    dimension in standard deviations of the reference.

    Raises:
        ValueError: If there are not as many of the one as of the other.
    """
    if samples.shape != reference.shape:
        raise ValueError(f"samples {samples.shape} and reference {reference.shape} must be as many")
    scale = np.maximum(reference.std(axis=0), FLOORS)
    directions = rng.normal(size=(len(DIMENSIONS), DIRECTIONS))
    directions /= np.linalg.norm(directions, axis=0)
    each = _apart(samples, reference)
    sliced = _apart(samples / scale @ directions, reference / scale @ directions).mean()
    return {**dict(zip(DIMENSIONS, each.tolist(), strict=True)), SLICED: float(sliced)}


def _apart(first: Samples, second: Samples) -> Samples:
    """Distance of every column: of as many samples, that of the sorted ones."""
    apart: Samples = np.abs(np.sort(first, axis=0) - np.sort(second, axis=0)).mean(axis=0)
    return apart
