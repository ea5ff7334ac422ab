"""Independent, named random streams from one root seed."""

from __future__ import annotations

import zlib

import numpy as np


def stream(seed: int, *names: str | int) -> np.random.Generator:
    """Generator that depends only on the seed and the names.

    Adding a stage, an episode or an environment therefore shifts no other stream's draws.

    Args:
        seed: Root seed, zero or positive.
        names: What the stream is for, from general to particular, e.g. ``"rollout", 17``.
    """
    words = [name if isinstance(name, int) else zlib.crc32(name.encode()) for name in names]
    return np.random.default_rng([seed, *words])
