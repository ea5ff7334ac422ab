"""What every denoiser has in common."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

import torch
from torch import Tensor, nn

from juicer.policy.condition import Condition, ConditionSizes
from juicer.policy.head import ChunkShape
from juicer.policy.members import DenoiserConfig


class Denoiser(nn.Module, ABC):
    """Network that looks at a noisy action chunk and predicts its noise or the clean chunk.

    It is built with its configuration, the shape of a chunk, and the sizes of a condition.
    """

    @abstractmethod
    def forward(self, noisy: Tensor, step: Tensor, condition: Condition) -> Tensor:
        """Prediction ``(B, T_p, A)``.

        Args:
            noisy: Normalised action chunks with noise, ``(B, T_p, A)``.
            step: Noise level of each, ``(B,)``, from 0 (nearly clean); a head may use levels between whole numbers.
            condition: What the policy observes.
        """


def build_denoiser(config: DenoiserConfig, chunk: ChunkShape, condition: ConditionSizes) -> Denoiser:
    """The denoiser of a configuration."""
    denoiser: Denoiser = config.network_class()(config, chunk, condition)
    return denoiser


class StepEmbedding(nn.Module):
    """Sinusoids of the noise level, ``(B,) -> (B, size)``: sines, then cosines, wavelengths up to 10^4."""

    def __init__(self, size: int) -> None:
        super().__init__()
        half = size // 2
        self.frequencies: Tensor
        exponents = torch.arange(half) / max(half - 1, 1)
        self.register_buffer("frequencies", torch.exp(-math.log(10_000.0) * exponents), persistent=False)

    def forward(self, step: Tensor) -> Tensor:
        """Embed noise levels."""
        angles = step.float().unsqueeze(-1) * self.frequencies
        return torch.cat([angles.sin(), angles.cos()], dim=-1)
