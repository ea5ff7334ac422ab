"""Scaling to [-1, 1] by the limits of the training data; the limits travel with the weights."""

from __future__ import annotations

import torch
from torch import Tensor, nn

SMALLEST_RANGE = 1e-4
"""A dimension that moves less than this (0.1 mm for a position) counts as constant and becomes zero."""


class Normalizer(nn.Module):
    """Per-dimension ``x -> 2 (x - low) / (high - low) - 1``, with constant dimensions mapped to zero.

    The original divides by zero on a constant dimension; here its scale is one, so that an unseen value
    shows at its natural size and decoding gives the constant back.
    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        super().__init__()
        self.offset: Tensor
        self.scale: Tensor
        self.register_buffer("offset", torch.zeros(shape))
        self.register_buffer("scale", torch.ones(shape))

    @torch.no_grad()
    def fit(self, values: Tensor) -> None:
        """Take the limits of ``values`` ``(..., *shape)``."""
        rows = values.reshape(-1, *self.offset.shape)
        self.set_limits(rows.amin(dim=0), rows.amax(dim=0))

    @torch.no_grad()
    def set_limits(self, low: Tensor, high: Tensor) -> None:
        """Take limits, each of this normaliser's shape."""
        half_range = (high - low) / 2
        self.offset.copy_((low + high) / 2)
        self.scale.copy_(torch.where(half_range * 2 < SMALLEST_RANGE, torch.ones_like(half_range), half_range))

    def normalize(self, values: Tensor) -> Tensor:
        """Values in units of the training range."""
        return (values - self.offset) / self.scale

    def denormalize(self, values: Tensor) -> Tensor:
        """Inverse of :meth:`normalize`."""
        return values * self.scale + self.offset
