"""A residual network without normalisation layers."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from juicer.policy.backbone import Backbone, SpatialSoftmax
from juicer.policy.backbones.small_cnn.config import SmallCNNConfig


class Block(nn.Module):
    """Two convolutions beside a skip, halving the size if ``stride`` is 2."""

    def __init__(self, inputs: int, outputs: int, stride: int) -> None:
        super().__init__()
        self.stride = stride
        self.first = nn.Conv2d(inputs, outputs, 3, stride, 1)
        self.second = nn.Conv2d(outputs, outputs, 3, 1, 1)
        self.skip = nn.Conv2d(inputs, outputs, 1) if inputs != outputs else nn.Identity()
        # It begins as its skip, so that depth does not blow up what no layer normalises.
        nn.init.zeros_(self.second.weight)

    def forward(self, x: Tensor) -> Tensor:
        """``(B, inputs, H, W) -> (B, outputs, ceil(H / stride), ceil(W / stride))``."""
        hidden = self.second(functional.relu(self.first(x)))
        small = functional.avg_pool2d(x, 2, ceil_mode=True) if self.stride == 2 else x
        return functional.relu(self.skip(small) + hidden)


class SmallCNN(Backbone):
    """See :class:`SmallCNNConfig`."""

    def __init__(self, config: SmallCNNConfig, size: tuple[int, int]) -> None:
        super().__init__()
        self.stem = nn.Conv2d(3, config.stem, 5, 2, 2)
        self.quarter = Block(config.stem, config.quarter, stride=2)
        self.eighth = nn.Sequential(
            Block(config.quarter, config.eighth, stride=2), Block(config.eighth, config.eighth, stride=1)
        )
        self.quarter_places = _places(config.quarter, config.quarter_maps)
        self.eighth_places = _places(config.eighth, config.eighth_maps)
        self.grid = nn.AdaptiveAvgPool2d(config.grid)
        self.num_features = config.rough_features()

    def forward(self, images: Tensor) -> Tensor:
        """See :class:`juicer.policy.backbone.Backbone`."""
        quarter = self.quarter(functional.relu(self.stem(images)))
        eighth = self.eighth(quarter)
        places = [
            place(x) for place, x in ((self.quarter_places, quarter), (self.eighth_places, eighth)) if place is not None
        ]
        return torch.cat([*places, self.grid(eighth).flatten(1).float()], dim=-1)


def _places(channels: int, maps: int) -> SpatialSoftmax | None:
    return SpatialSoftmax(channels, maps) if maps else None
