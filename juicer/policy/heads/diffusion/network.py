"""Denoising diffusion over action chunks: DDPM training, deterministic DDIM sampling.

Ho et al. 2020; squared-cosine schedule of Nichol and Dhariwal 2021; sampler of Song et al. 2021 with eta 0.
"""

from __future__ import annotations

import itertools
import math

import torch
from torch import Tensor

from juicer.policy import draws
from juicer.policy.condition import Condition, ConditionSizes
from juicer.policy.denoiser import build_denoiser
from juicer.policy.head import ActionHead, ChunkShape, squared_error
from juicer.policy.heads.diffusion.config import DiffusionConfig

COSINE_OFFSET = 0.008
LARGEST_BETA = 0.999


def signal_levels(train_timesteps: int) -> Tensor:
    """Cumulative signal power alpha_bar ``(train_timesteps,)`` in double precision, from nearly one to nearly zero."""

    def signal(time: float) -> float:
        return math.cos((time + COSINE_OFFSET) / (1 + COSINE_OFFSET) * math.pi / 2) ** 2

    kept = [
        1 - min(1 - signal((step + 1) / train_timesteps) / signal(step / train_timesteps), LARGEST_BETA)
        for step in range(train_timesteps)
    ]
    return torch.tensor(kept, dtype=torch.float64).cumprod(0)


def sampling_steps(config: DiffusionConfig) -> list[int]:
    """Noise levels that the sampler visits, from high to low."""
    if config.spacing == "leading":
        stride = config.train_timesteps // config.inference_steps
        return [stride * index for index in reversed(range(config.inference_steps))]
    stretch = config.train_timesteps / config.inference_steps
    return [round(config.train_timesteps - stretch * index) - 1 for index in range(config.inference_steps)]


class DiffusionHead(ActionHead):
    """Conditional diffusion over normalised action chunks."""

    def __init__(self, config: DiffusionConfig, chunk: ChunkShape, condition: ConditionSizes) -> None:
        super().__init__()
        self.config = config
        self.denoiser = build_denoiser(config.denoiser, chunk, condition)
        levels = signal_levels(config.train_timesteps)
        self.signal_scale: Tensor
        self.noise_scale: Tensor
        self.register_buffer("signal_scale", levels.sqrt().float(), persistent=False)
        self.register_buffer("noise_scale", (1 - levels).sqrt().float(), persistent=False)

    def compute_loss(self, condition: Condition, chunk: Tensor) -> Tensor:
        """Squared error of the predicted noise, or of the predicted chunk, at one random noise level a sample."""
        noise = draws.randn(chunk.shape, chunk.device)
        step = draws.randint(self.config.train_timesteps, chunk.shape[:1], chunk.device)
        noisy = self.signal_scale[step, None, None] * chunk + self.noise_scale[step, None, None] * noise
        target = noise if self.config.prediction == "epsilon" else chunk
        return squared_error(self.denoiser(noisy, step, condition), target)

    def sample(self, condition: Condition, noise: Tensor) -> Tensor:
        """Walk from noise to a chunk within [-1, 1]."""
        steps = sampling_steps(self.config)
        clean = self._clean_chunk(noise, steps[0], condition)
        noisy = noise
        for step, next_step in itertools.pairwise(steps):
            # The noise that is consistent with the clipped chunk, so that clipping is never undone.
            remaining = (noisy - self.signal_scale[step] * clean) / self.noise_scale[step]
            noisy = self.signal_scale[next_step] * clean + self.noise_scale[next_step] * remaining
            clean = self._clean_chunk(noisy, next_step, condition)
        return clean

    def _clean_chunk(self, noisy: Tensor, step: int, condition: Condition) -> Tensor:
        output: Tensor = self.denoiser(noisy, torch.full((len(noisy),), step, device=noisy.device), condition)
        if self.config.prediction == "epsilon":
            output = (noisy - self.noise_scale[step] * output) / self.signal_scale[step]
        return output.clamp(-1, 1)
