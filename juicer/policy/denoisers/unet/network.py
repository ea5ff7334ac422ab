"""The paper's denoiser: a 1-D U-Net along the time axis of an action chunk."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from juicer.policy.condition import Condition, ConditionSizes, flat, flat_size
from juicer.policy.denoiser import Denoiser, StepEmbedding
from juicer.policy.denoisers.unet.config import UNetConfig
from juicer.policy.head import ChunkShape


class ConvBlock(nn.Sequential):
    """Convolution that keeps the length, group normalisation, Mish."""

    def __init__(self, inputs: int, outputs: int, config: UNetConfig) -> None:
        super().__init__(
            nn.Conv1d(inputs, outputs, config.kernel_size, padding=config.kernel_size // 2),
            nn.GroupNorm(config.groups, outputs),
            nn.Mish(),
        )


class ConvolutionBlock(nn.Module):
    """Two convolutions around a feature-wise scale and bias drawn from the condition (FiLM)."""

    def __init__(self, inputs: int, outputs: int, condition_size: int, config: UNetConfig) -> None:
        super().__init__()
        self.first = ConvBlock(inputs, outputs, config)
        self.second = ConvBlock(outputs, outputs, config)
        self.modulation = nn.Sequential(nn.Mish(), nn.Linear(condition_size, 2 * outputs))
        self.skip = nn.Conv1d(inputs, outputs, 1) if inputs != outputs else nn.Identity()

    def forward(self, x: Tensor, condition: Tensor) -> Tensor:
        """``(B, inputs, T) -> (B, outputs, T)``."""
        scale, bias = self.modulation(condition).unsqueeze(-1).chunk(2, dim=1)
        hidden = self.second(scale * self.first(x) + bias)
        return torch.as_tensor(hidden + self.skip(x))


class UNetDenoiser(Denoiser):
    """U-Net of three resolutions; 69,123,594 parameters at action size 10 and condition size 272.

    Each level holds two residual blocks. The skip of the first level stays unused, as in the original.
    """

    def __init__(self, config: UNetConfig, chunk: ChunkShape, condition: ConditionSizes) -> None:
        super().__init__()
        _, action_size = chunk
        low, middle, high = config.channels
        embedding = config.step_embedding
        size = embedding + flat_size(condition)
        self.step_encoder = nn.Sequential(
            StepEmbedding(embedding),
            nn.Linear(embedding, 4 * embedding),
            nn.Mish(),
            nn.Linear(4 * embedding, embedding),
        )

        def level(inputs: int, outputs: int) -> nn.ModuleList:
            return nn.ModuleList(
                [ConvolutionBlock(inputs, outputs, size, config), ConvolutionBlock(outputs, outputs, size, config)]
            )

        self.down = nn.ModuleList([level(action_size, low), level(low, middle), level(middle, high)])
        self.downsample = nn.ModuleList([nn.Conv1d(channels, channels, 3, 2, 1) for channels in (low, middle)])
        self.middle = level(high, high)
        self.up = nn.ModuleList([level(2 * high, middle), level(2 * middle, low)])
        self.upsample = nn.ModuleList([nn.ConvTranspose1d(channels, channels, 4, 2, 1) for channels in (middle, low)])
        self.head = nn.Sequential(ConvBlock(low, low, config), nn.Conv1d(low, action_size, 1))

    def forward(self, noisy: Tensor, step: Tensor, condition: Condition) -> Tensor:
        """See :class:`Denoiser`."""
        told = torch.cat([self.step_encoder(step), flat(condition)], dim=-1)

        def run(blocks: nn.Module, x: Tensor) -> Tensor:
            for block in blocks.children():
                x = block(x, told)
            return x

        fine = run(self.down[0], noisy.transpose(1, 2))
        medium = run(self.down[1], self.downsample[0](fine))
        coarse = run(self.down[2], self.downsample[1](medium))
        x = run(self.middle, coarse)
        x = self.upsample[0](run(self.up[0], torch.cat([x, coarse], dim=1)))
        x = self.upsample[1](run(self.up[1], torch.cat([x, medium], dim=1)))
        return torch.as_tensor(self.head(x)).transpose(1, 2)
