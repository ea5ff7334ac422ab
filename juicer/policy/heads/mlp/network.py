"""The paper's baseline: a residual MLP that regresses the whole action chunk at once."""

from __future__ import annotations

from math import prod
from typing import cast

from torch import Tensor, nn
from torch.nn import functional

from juicer.policy.condition import Condition, ConditionSizes, flat, flat_size
from juicer.policy.draws import Dropout
from juicer.policy.head import ActionHead, ChunkShape, squared_error
from juicer.policy.heads.mlp.config import MLPHeadConfig


class ResidualLayer(nn.Module):
    """``x <- ReLU(x + W2 dropout(ReLU(W1 x)))``."""

    def __init__(self, width: int, dropout: float) -> None:
        super().__init__()
        self.inner = nn.Sequential(nn.Linear(width, width), nn.ReLU(), Dropout(dropout), nn.Linear(width, width))

    def forward(self, x: Tensor) -> Tensor:
        """``(B, width) -> (B, width)``."""
        return functional.relu(x + self.inner(x))


class MLPHead(ActionHead):
    """Regression by mean squared error.

    At condition size 272: 11,103,552 parameters for 32 actions of 10, 10,785,802 for one.
    """

    def __init__(self, config: MLPHeadConfig, chunk: ChunkShape, condition: ConditionSizes) -> None:
        super().__init__()
        self.chunk_shape = chunk
        self.layers = nn.Sequential(
            nn.Linear(flat_size(condition), config.width),
            *(ResidualLayer(config.width, config.dropout) for _ in range(config.blocks)),
            nn.Linear(config.width, prod(chunk)),
        )

    def compute_loss(self, condition: Condition, chunk: Tensor) -> Tensor:
        """Squared error of every entry, ``(B, T_p, A)``."""
        return squared_error(self(condition), chunk)

    def sample(self, condition: Condition, noise: Tensor) -> Tensor:
        """The prediction; it has no randomness, ``noise`` only gives the shape."""
        return cast(Tensor, self(condition))

    def forward(self, condition: Condition) -> Tensor:
        """Chunks ``(B, T_p, A)``."""
        return cast(Tensor, self.layers(flat(condition))).reshape(-1, *self.chunk_shape)
