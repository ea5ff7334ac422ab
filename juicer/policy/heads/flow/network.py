"""Flow from noise to action chunks whose network is told how far it is to jump, so that one jump may do.

Shortcut models (Frans et al. 2025, arXiv 2410.12557): the shortest jumps are learned from data, a longer one from two
of half its length, in one training. As in pixel mean flow (Lu et al. 2026, arXiv 2601.22158), the network predicts the
clean chunk that a jump aims at instead of a velocity: chunks are alike where velocities differ as much as noise does.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from juicer.policy.condition import Condition, ConditionSizes
from juicer.policy.denoiser import build_denoiser
from juicer.policy.head import ActionHead, ChunkShape, squared_error
from juicer.policy.heads.flow.config import FlowConfig

JUMP = "length of the jump"
"""Part of the condition that the head adds; no encoder can be called so."""

FULL_NOISE = 100
"""Noise level that the denoiser is told at full noise."""


class FlowHead(ActionHead):
    """Straight paths from noise (time 1) to normalised action chunks (time 0), walked in jumps of equal length.

    A jump of level k has the length ``2**k / finest_steps``.
    """

    def __init__(self, config: FlowConfig, chunk: ChunkShape, condition: ConditionSizes) -> None:
        super().__init__()
        self.config = config
        self.num_levels = config.finest_steps.bit_length()
        self.denoiser = build_denoiser(config.denoiser, chunk, {**condition, JUMP: (1, self.num_levels)})

    def compute_loss(self, condition: Condition, chunk: Tensor) -> Tensor:
        """Squared error of what a jump from a random place aims at, ``(B, T_p, A)``.

        The leading rows learn the longer jumps, so rows must be in random order.
        """
        rows, longer = len(chunk), round(self.config.longer_jumps * len(chunk))
        level = torch.zeros(rows, dtype=torch.long, device=chunk.device)
        level[:longer] = torch.randint(1, self.num_levels, (longer,), device=chunk.device)
        length = self._length(level)
        time = length * (1 + (torch.rand(rows, device=chunk.device) / length).floor())
        noisy = torch.lerp(chunk, torch.randn_like(chunk), time[:, None, None])
        shown = {name: tokens[:longer] for name, tokens in condition.items()}
        aims = self._aim_of_two(noisy[:longer], time[:longer], level[:longer], shown)
        return squared_error(self._aim(noisy, time, level, condition), torch.cat([aims, chunk[longer:]]))

    def sample(self, condition: Condition, noise: Tensor) -> Tensor:
        """Walk from noise to a chunk within [-1, 1]."""
        rows, steps = len(noise), self.config.inference_steps
        level = torch.full((rows,), self.num_levels - steps.bit_length(), device=noise.device)
        noisy = noise
        for left in range(steps, 0, -1):
            time = torch.full((rows,), left / steps, device=noise.device)
            noisy = torch.lerp(noisy, self._aim(noisy, time, level, condition).clamp(-1, 1), 1 / left)
        return noisy

    @torch.no_grad()
    def _aim_of_two(self, noisy: Tensor, time: Tensor, level: Tensor, condition: Condition) -> Tensor:
        """Clean chunk that a jump aims at if it ends where two of half its length do."""
        half, shorter = self._length(level) / 2, level - 1
        first = self._aim(noisy, time, shorter, condition).clamp(-1, 1)
        midway = torch.lerp(noisy, first, (half / time)[:, None, None])
        second = self._aim(midway, time - half, shorter, condition).clamp(-1, 1)
        return torch.lerp(first, second, (time / (2 * (time - half)))[:, None, None])

    def _aim(self, noisy: Tensor, time: Tensor, level: Tensor, condition: Condition) -> Tensor:
        """Clean chunk towards which a jump of a level moves noisy chunks."""
        jump = functional.one_hot(level, self.num_levels).to(noisy.dtype).unsqueeze(1)
        aim: Tensor = self.denoiser(noisy, FULL_NOISE * time, {**condition, JUMP: jump})
        return aim.float()

    def _length(self, level: Tensor) -> Tensor:
        return 2.0**level / self.config.finest_steps
