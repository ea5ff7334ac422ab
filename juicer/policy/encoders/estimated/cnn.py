"""A convolutional network for CPUs: it turns an image into what is where in it.

Patches of 4x4 pixels become channels at once, and from there on all convolutions are dense, 3x3, and have several dozen
channels: that is what processors with bfloat16 do fast, at 200 billion products a second and core. A larger image of few
channels, depthwise convolutions, and normalisation by groups each cost several times what they compute.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from juicer.policy.encoders.estimated.config import CnnConfig

PATCH = 4
"""Pixels a side that become one."""
CELLS = 3
"""Rows, and columns, over which the last maps are averaged."""


class Cnn(nn.Module):
    """Where things are in an image: centres of mass of learned maps, and means of others over a coarse grid.

    Attributes:
        size: Numbers that it yields.
    """

    def __init__(self, config: CnnConfig, image_size: tuple[int, int]) -> None:
        """Build it for images of a height and width."""
        super().__init__()
        (fine, coarse), (num_fine, num_coarse) = config.width, config.blocks
        self.fine = nn.Sequential(nn.Conv2d(3 * PATCH**2, fine, 3, padding=1), *(Block(fine) for _ in range(num_fine)))
        self.down = nn.Conv2d(fine, coarse, 3, stride=2, padding=1)
        self.coarse = nn.Sequential(*(Block(coarse) for _ in range(num_coarse)))
        self.points = nn.ModuleList([Points(fine, config.points), Points(coarse, config.points)])
        self.size = 4 * config.points + CELLS**2 * coarse

    def forward(self, images: Tensor) -> Tensor:
        """Numbers ``(B, size)`` of images ``(B, 3, H, W)``."""
        patches = functional.pixel_unshuffle(images, PATCH).contiguous(memory_format=torch.channels_last)
        fine = self.fine(patches)
        coarse = self.coarse(self.down(functional.relu(fine)))
        cells = functional.adaptive_avg_pool2d(functional.relu(coarse), CELLS).flatten(1)
        return torch.cat([self.points[0](fine), self.points[1](coarse), cells.float()], dim=-1)


class Block(nn.Module):
    """Adds to its input what two convolutions make of it."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.first, self.second = nn.Conv2d(width, width, 3, padding=1), nn.Conv2d(width, width, 3, padding=1)
        with torch.no_grad():  # Without normalisation, sums of many blocks would grow.
            self.second.weight *= 0.2

    def forward(self, images: Tensor) -> Tensor:
        """Maps of the same shape."""
        added: Tensor = self.second(functional.relu(self.first(functional.relu(images))))
        return images + added


class Points(nn.Module):
    """Centres of mass of learned maps (a spatial softmax): finer than the maps' own resolution."""

    def __init__(self, channels: int, points: int) -> None:
        super().__init__()
        self.maps = nn.Conv2d(channels, points, 1)

    def forward(self, images: Tensor) -> Tensor:
        """Coordinates ``(B, 2 points)`` in [-1, 1] of maps ``(B, C, H, W)``."""
        maps = self.maps(functional.relu(images)).float()
        mass = maps.flatten(2).softmax(dim=-1).view_as(maps)
        across, down = (torch.linspace(-1, 1, size, device=maps.device) for size in (maps.shape[-1], maps.shape[-2]))
        return torch.cat([(mass.sum(dim=-2) * across).sum(dim=-1), (mass.sum(dim=-1) * down).sum(dim=-1)], dim=-1)
