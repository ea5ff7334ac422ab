"""Random numbers for the samples of a batch, of which this process may hold a part.

All that is random in a network's loss is drawn here. A process that learns from its part of every batch draws for the
whole batch and keeps the rows of its own samples: a sample gets the same numbers, however many processes share a batch.
But for dropout they come from the processor's generator, so that every device learns from the same ones.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional


@dataclass(frozen=True)
class Part:
    """Consecutive samples of a batch.

    Attributes:
        first: Number of the first one.
        size: How many there are.
        total: How many the whole batch has.
    """

    first: int
    size: int
    total: int

    @property
    def rows(self) -> slice:
        """Which rows of the batch they are."""
        return slice(self.first, self.first + self.size)


_part: Part | None = None


@contextmanager
def drawing_for(part: Part | None) -> Iterator[None]:
    """Within the block, tensors hold this part of a batch; all of it if None."""
    global _part
    outer, _part = _part, part
    try:
        yield
    finally:
        _part = outer


def randn(shape: Sequence[int], device: torch.device | None = None) -> Tensor:
    """Normal noise; as everywhere here, ``shape`` begins with the samples, or with several rows of each in a line."""
    return _own(lambda rows: torch.randn(rows, *shape[1:]).to(device, non_blocking=True), shape[0])


def rand(shape: Sequence[int], device: torch.device | None = None) -> Tensor:
    """Uniform in [0, 1)."""
    return _own(lambda rows: torch.rand(rows, *shape[1:]).to(device, non_blocking=True), shape[0])


def randint(high: int, shape: Sequence[int], device: torch.device | None = None) -> Tensor:
    """Integers from 0 to ``high - 1``."""
    return _own(lambda rows: torch.randint(high, (rows, *shape[1:])).to(device, non_blocking=True), shape[0])


class Dropout(nn.Module):
    """Like :class:`torch.nn.Dropout`."""

    def __init__(self, probability: float) -> None:
        super().__init__()
        self.probability = probability

    def forward(self, x: Tensor) -> Tensor:
        """``(B, ...) -> (B, ...)``."""
        if _part is None or not self.training:
            return functional.dropout(x, self.probability, self.training)
        kept = _own(lambda rows: functional.dropout(x.new_ones(rows, *x.shape[1:]), self.probability), len(x))
        return x * kept


def _own(draw: Callable[[int], Tensor], num_rows: int) -> Tensor:
    if _part is None:
        return draw(num_rows)
    rows_each = num_rows // _part.size
    start = _part.first * rows_each
    return draw(_part.total * rows_each)[start : start + num_rows]
