"""What a head is shown: tokens by name, as many parts as there are encoders."""

from __future__ import annotations

from collections.abc import Mapping
from math import prod

import torch
from torch import Tensor

Condition = Mapping[str, Tensor]
"""Tokens ``(B, K, C)`` of every part; K and C are the part's own."""

ConditionSizes = Mapping[str, tuple[int, int]]
"""Number of tokens K and their length C, of every part."""


def flat_size(sizes: ConditionSizes) -> int:
    """Length of :func:`flat` rows."""
    return sum(prod(size) for size in sizes.values())


def flat(condition: Condition) -> Tensor:
    """All tokens side by side, ``(B, sum of K C)``, for networks that take one vector."""
    return torch.cat([tokens.flatten(1) for tokens in condition.values()], dim=-1)
