"""A residual network that begins with patches."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from juicer.policy.backbone import Backbone, SpatialSoftmax
from juicer.policy.backbones.patch_cnn.config import PATCH, PatchCNNConfig

BRANCH_SCALE = 0.2
"""Of what a block adds at first: without normalisation, sums of many blocks would grow."""


class Block(nn.Module):
    """Adds to maps what two convolutions make of them."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(channels, channels, 3, padding=1)
        self.second = nn.Conv2d(channels, channels, 3, padding=1)
        with torch.no_grad():
            self.second.weight *= BRANCH_SCALE

    def forward(self, x: Tensor) -> Tensor:
        """Maps of the same shape."""
        added: Tensor = self.second(functional.relu(self.first(functional.relu(x))))
        return x + added


class PatchCNN(Backbone):
    """See :class:`PatchCNNConfig`."""

    def __init__(self, config: PatchCNNConfig, size: tuple[int, int]) -> None:
        super().__init__()
        quarter, eighth = config.quarter, config.eighth
        self.stem = nn.Conv2d(3 * PATCH**2, quarter, 3, padding=1)
        self.quarter = nn.Sequential(*(Block(quarter) for _ in range(config.quarter_blocks)))
        self.down = nn.Conv2d(quarter, eighth, 3, stride=2, padding=1)
        self.eighth = nn.Sequential(*(Block(eighth) for _ in range(config.eighth_blocks)))
        self.quarter_places = SpatialSoftmax(quarter, config.maps)
        self.eighth_places = SpatialSoftmax(eighth, config.maps)
        self.grid = nn.AdaptiveAvgPool2d(config.grid)

    def forward(self, images: Tensor) -> Tensor:
        """See :class:`juicer.policy.backbone.Backbone`."""
        patches = functional.pixel_unshuffle(images, PATCH).contiguous(memory_format=torch.channels_last)
        quarter = functional.relu(self.quarter(self.stem(patches)))
        eighth = functional.relu(self.eighth(self.down(quarter)))
        places = self.quarter_places(quarter), self.eighth_places(eighth)
        return torch.cat([*places, self.grid(eighth).flatten(1).float()], dim=-1)
