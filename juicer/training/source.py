"""Where a training takes its windows from, and in what order."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from juicer.policy.encoder import Prepared
from juicer.seeding import stream
from juicer.training.config import StateNoise


@dataclass(frozen=True)
class Batch:
    """Windows ready for the network.

    Attributes:
        prepared: Prepared observations ``(B, T_o, F)``.
        chunk: Encoded, normalised actions ``(B, T_p, 10)``.
        weight: ``(B, T_p, 1)`` one where an action is a target, zero where not.
    """

    prepared: Prepared
    chunk: Tensor
    weight: Tensor

    def average(self, losses: Tensor) -> Tensor:
        """Mean over the targets of losses ``(B, T_p, 10)``."""
        return (losses * self.weight).sum() / (self.weight.sum() * losses.shape[-1])


class WindowSource(Protocol):
    """Windows of a network's training data, in memory or wherever else; what they show is prepared and normalised."""

    def __len__(self) -> int:
        """Number of windows."""
        ...

    @property
    def image_bytes(self) -> int:
        """Bytes of the images that a window shows."""
        ...

    def gather(self, rows: Tensor, noise: StateNoise | None = None) -> Batch:
        """Windows ``(B,)`` by number; noise falls on the leading rows, so ``rows`` must be in random order for it."""
        ...

    def recorded(self, rows: Tensor) -> tuple[Tensor, Tensor]:
        """Absolute actions ``(B, T_p, 10)`` and current proprioception ``(B, 16)`` of windows."""
        ...


class BatchOrder:
    """Which windows each training step sees: every window once an epoch, shuffled anew.

    If they have weights, an epoch draws as many windows as there are, each with a chance in proportion to its weight.

    The rows of a step are a function of the seed and the step alone, so that a resumed training needs no memory
    of the order.
    """

    def __init__(
        self, num_windows: int, batch_size: int, seed: int, weights: NDArray[np.float64] | None = None
    ) -> None:
        self._num_windows = num_windows
        self._chances = None if weights is None else weights / weights.sum()
        self._batch_size = batch_size
        self._seed = seed
        self._epoch = -1
        self._shuffled: NDArray[np.int64] = np.empty(0, dtype=np.int64)

    def rows(self, step: int) -> Tensor:
        """Indices ``(batch_size,)`` of the windows of a step; a batch may reach into the next epoch."""
        start, end = step * self._batch_size, (step + 1) * self._batch_size
        parts = []
        while start < end:
            epoch, offset = divmod(start, self._num_windows)
            part = self._shuffle(epoch)[offset : offset + end - start]
            parts.append(part)
            start += len(part)
        return torch.from_numpy(np.concatenate(parts))

    def _shuffle(self, epoch: int) -> NDArray[np.int64]:
        if epoch != self._epoch:
            self._epoch = epoch
            rng, number = stream(self._seed, "order", epoch), self._num_windows
            chances = self._chances
            self._shuffled = rng.permutation(number) if chances is None else rng.choice(number, number, p=chances)
        return self._shuffled
