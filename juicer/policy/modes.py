"""Which of many samples lies where they are densest: a kernel density estimate in the space of action chunks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

BLOCK = 512
"""Samples whose distances to all others are in memory at a time."""


def densest(samples: NDArray[np.floating]) -> int:
    """Index of the sample at which the density of all of them is highest; the first of equals.

    The kernel is Gaussian and equally wide in every direction. Its width is Scott's, ``n ** (-1 / (d + 4))`` standard
    deviations, where d is not the length of a sample but the number of directions in which samples really spread (the
    participation ratio of their variances): the actions of a chunk move together, and in as many dimensions as they
    have numbers no two samples would be neighbours. A sample's own kernel adds the same to every density and is left
    out, as it would drown what the others add.

    Args:
        samples: ``(n, ...)``, entries of comparable scale.
    """
    number = len(samples)
    points = np.asarray(samples, dtype=np.float64).reshape(number, -1)
    points = points - points.mean(axis=0)
    covariance = points.T @ points / number
    variance = np.trace(covariance)
    if variance == 0:
        return 0
    directions = variance**2 / np.square(covariance).sum()
    width_squared = variance / directions * number ** (-2 / (directions + 4))
    lengths = np.square(points).sum(axis=1)
    density = np.empty(number)
    from scipy.special import logsumexp  # takes long to import, and only this way of acting needs it

    for start in range(0, number, BLOCK):
        block = np.arange(start, min(start + BLOCK, number))
        squared = lengths[block, None] + lengths - 2 * points[block] @ points.T
        squared[block - start, block] = np.inf
        density[block] = logsumexp(-squared / (2 * width_squared), axis=1)
    return int(density.argmax())
