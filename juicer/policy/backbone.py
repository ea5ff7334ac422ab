"""What every network from images to features has in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping

import torch
from torch import Tensor, nn
from torch.nn import functional

from juicer.policy.members import BackboneConfig

FULL_BRIGHTNESS = 255
"""Of a colour of a pixel."""
SMALLEST_BATCH = 64
"""Images below which statistics of a batch are too uncertain to learn from."""


class Backbone(nn.Module, ABC):
    """Network from images to features.

    It is built with its configuration and the height and width of its images.

    Attributes:
        config: What it was built of.
    """

    config: BackboneConfig

    @abstractmethod
    def forward(self, images: Tensor) -> Tensor:
        """Features ``(B, C)`` of images ``(B, 3, H, W)``, normalised by :class:`Pixels`."""

    def adapted(self, weights: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """State of this network by the weights of a file, of which what serves another purpose is left out."""
        return dict(weights)


def build_backbone(config: BackboneConfig, size: tuple[int, int]) -> Backbone:
    """The backbone of a configuration, with random weights, for images of a height and width."""
    backbone: Backbone = config.network_class()(config, size)
    backbone.config = config
    return backbone


def to_shares(images: Tensor) -> Tensor:
    """Images ``(B, h, w, 3)`` uint8 as shares of full brightness ``(B, 3, h, w)``; in memory, colours stay together."""
    return images.permute(0, 3, 1, 2).float() / FULL_BRIGHTNESS


class Pixels(nn.Module):
    """Brightness from 0 to 1 becomes what the backbone of a configuration wants to see."""

    def __init__(self, config: BackboneConfig) -> None:
        super().__init__()
        self.mean: Tensor
        self.std: Tensor
        self.register_buffer("mean", torch.tensor(config.pixel_mean).view(3, 1, 1), persistent=False)
        self.register_buffer("std", torch.tensor(config.pixel_std).view(3, 1, 1), persistent=False)

    def forward(self, images: Tensor) -> Tensor:
        """Images ``(B, 3, H, W)`` of the same shape."""
        return (images - self.mean) / self.std


class SpatialSoftmax(nn.Module):
    """Where in an image each of some learned maps is bright: expected x and y, from -1 (left, top) to 1."""

    def __init__(self, channels: int, maps: int) -> None:
        super().__init__()
        self.maps = nn.Conv2d(channels, maps, 1)

    def forward(self, x: Tensor) -> Tensor:
        """``(B, channels, H, W) -> (B, 2 maps)``, x and y of each map in turn."""
        height, width = x.shape[-2:]
        # In single precision whatever the autocast: bfloat16 tells positions to a half per cent at best.
        share = self.maps(x).flatten(2).float().softmax(dim=-1).unflatten(-1, (height, width))
        columns = torch.linspace(-1, 1, width, device=x.device)
        rows = torch.linspace(-1, 1, height, device=x.device)
        expected = [(share.sum(dim=-2) * columns).sum(dim=-1), (share.sum(dim=-1) * rows).sum(dim=-1)]
        return torch.stack(expected, dim=-1).flatten(1)


class BatchNorm(nn.BatchNorm2d):
    """Batch normalisation whose statistics stay as they are while batches are small, when acting or not.

    A few dozen images of one robot would replace the statistics of millions within some hundred steps.
    """

    @staticmethod
    def takes_statistics(images: int) -> bool:
        """Whether a batch of so many images is large enough for statistics of its own."""
        return images >= SMALLEST_BATCH

    def forward(self, input: Tensor) -> Tensor:
        """``(B, C, H, W)`` of the same shape."""
        if not self.training or self.takes_statistics(len(input)):
            return super().forward(input)
        return functional.batch_norm(
            input, self.running_mean, self.running_var, self.weight, self.bias, training=False, eps=self.eps
        )
