"""Flow matching over action chunks, made for a single step.

Straight paths from noise to data (Liu et al. 2023, arXiv 2209.03003; Lipman et al. 2023, arXiv 2210.02747). The network
predicts the clean chunk at their end and not the velocity along them, as in the minimal iterative policy (Pan et al.
2025, arXiv 2512.01809). So a single step yields the mean of the chunks that fit an observation, more steps one of them.
"""

from __future__ import annotations

import torch
from torch import Tensor

from juicer.policy import draws
from juicer.policy.condition import Condition, ConditionSizes
from juicer.policy.denoiser import build_denoiser
from juicer.policy.head import ActionHead, ChunkShape, squared_error
from juicer.policy.heads.flow.config import FlowConfig

FULL_NOISE = 100
"""Noise level that the denoiser is told at time 1."""


class FlowHead(ActionHead):
    """Straight paths from noise (time 1) to normalised action chunks (time 0), walked in equal steps."""

    def __init__(self, config: FlowConfig, chunk: ChunkShape, condition: ConditionSizes) -> None:
        super().__init__()
        self.config = config
        self.denoiser = build_denoiser(config.denoiser, chunk, condition)

    def compute_loss(self, condition: Condition, chunk: Tensor) -> Tensor:
        """Squared error of the chunk predicted from one random place on the path to it, ``(B, T_p, A)``."""
        time = 1 - draws.rand(chunk.shape[:1], chunk.device)
        noisy = torch.lerp(chunk, draws.randn(chunk.shape, chunk.device), time[:, None, None])
        return squared_error(self.denoiser(noisy, FULL_NOISE * time, condition), chunk)

    def sample(self, condition: Condition, noise: Tensor) -> Tensor:
        """Walk from noise to a chunk within [-1, 1]."""
        steps = self.config.inference_steps
        noisy = noise
        for left in range(steps, 0, -1):
            time = torch.full((len(noise),), left / steps, device=noise.device)
            clean = self.denoiser(noisy, FULL_NOISE * time, condition).clamp(-1, 1)
            noisy = torch.lerp(noisy, clean, 1 / left)
        return noisy
