"""A denoiser for CPUs: a residual MLP on the flattened action chunk."""

from __future__ import annotations

from typing import cast

import torch
from torch import Tensor, nn
from torch.nn import functional

from juicer.policy.config import MLPDenoiserConfig
from juicer.policy.denoiser import Denoiser, StepEmbedding


class ModulatedBlock(nn.Module):
    """Residual pair of layers whose normalised input is scaled and shifted by the condition."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(width, elementwise_affine=False)
        self.first = nn.Linear(width, width)
        self.second = nn.Linear(width, width)

    def forward(self, x: Tensor, scale: Tensor, shift: Tensor) -> Tensor:
        """``(B, width) -> (B, width)``."""
        hidden = torch.addcmul(shift, self.norm(x), 1 + scale)
        return cast(Tensor, x + self.second(functional.silu(self.first(hidden))))


class MLPDenoiser(Denoiser):
    """Residual MLP with feature-wise modulation by observation and noise level."""

    def __init__(self, pred_horizon: int, action_size: int, condition_size: int, config: MLPDenoiserConfig) -> None:
        super().__init__()
        self.chunk_shape = (pred_horizon, action_size)
        chunk_size, width = pred_horizon * action_size, config.width
        self.step_embedding = StepEmbedding(config.step_embedding)
        self.context = nn.Sequential(
            nn.Linear(config.step_embedding + condition_size, width), nn.SiLU(), nn.Linear(width, width), nn.SiLU()
        )
        self.modulation = nn.Linear(width, 2 * width * config.blocks)
        self.stem = nn.Linear(chunk_size, width)
        self.blocks = nn.ModuleList([ModulatedBlock(width) for _ in range(config.blocks)])
        self.head = nn.Sequential(nn.LayerNorm(width), nn.Linear(width, chunk_size))

    def forward(self, noisy: Tensor, step: Tensor, condition: Tensor) -> Tensor:
        """See :class:`Denoiser`."""
        context = self.context(torch.cat([self.step_embedding(step), condition], dim=-1))
        modulation = self.modulation(context).chunk(2 * len(self.blocks), dim=-1)
        x = self.stem(noisy.flatten(1))
        for block, scale, shift in zip(self.blocks, modulation[::2], modulation[1::2], strict=True):
            x = block(x, scale, shift)
        return cast(Tensor, self.head(x)).reshape(-1, *self.chunk_shape)
