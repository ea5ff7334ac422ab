"""ResNet as in torchvision (its v1.5: a bottleneck strides in its 3x3 convolution), with either normalisation."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from torch import Tensor, nn
from torch.nn import functional

from juicer.policy.backbone import Backbone, BatchNorm, SpatialSoftmax
from juicer.policy.backbones.resnet.config import BLOCKS, CHANNELS, EXPANSION, ResNetConfig

CHANNELS_A_GROUP = 16
_LANGUAGE = "lang_"
"""What the weights of R3M begin with that read sentences."""
_STATISTICS = ("running_mean", "running_var", "num_batches_tracked")

Norm = Callable[[int], nn.Module]


class BasicBlock(nn.Module):
    """Two 3x3 convolutions beside a skip."""

    def __init__(self, inputs: int, width: int, stride: int, norm: Norm) -> None:
        super().__init__()
        self.conv1 = _convolution(inputs, width, 3, stride)
        self.bn1 = norm(width)
        self.conv2 = _convolution(width, width, 3)
        self.bn2 = norm(width)
        self.downsample = _skip(inputs, width, stride, norm)

    def forward(self, x: Tensor) -> Tensor:
        """``(B, inputs, H, W) -> (B, width, H / stride, W / stride)``."""
        hidden = functional.relu(self.bn1(self.conv1(x)))
        return functional.relu(self.bn2(self.conv2(hidden)) + self.downsample(x))


class Bottleneck(nn.Module):
    """A 3x3 convolution between two 1x1 ones, the last of which is four times as wide, beside a skip."""

    def __init__(self, inputs: int, width: int, stride: int, norm: Norm) -> None:
        super().__init__()
        outputs = EXPANSION[50] * width
        self.conv1 = _convolution(inputs, width, 1)
        self.bn1 = norm(width)
        self.conv2 = _convolution(width, width, 3, stride)
        self.bn2 = norm(width)
        self.conv3 = _convolution(width, outputs, 1)
        self.bn3 = norm(outputs)
        self.downsample = _skip(inputs, outputs, stride, norm)

    def forward(self, x: Tensor) -> Tensor:
        """``(B, inputs, H, W) -> (B, 4 width, H / stride, W / stride)``."""
        hidden = functional.relu(self.bn1(self.conv1(x)))
        hidden = functional.relu(self.bn2(self.conv2(hidden)))
        return functional.relu(self.bn3(self.conv3(hidden)) + self.downsample(x))


class ResNet(Backbone):
    """See :class:`ResNetConfig`."""

    def __init__(self, config: ResNetConfig, size: tuple[int, int]) -> None:
        super().__init__()
        self.keeps_statistics = config.norm == "batch"
        self.keeps_affine = self.keeps_statistics or config.keep_affine
        norm = BatchNorm if config.norm == "batch" else _group_norm
        self.conv1 = _convolution(3, CHANNELS[0], 7, 2)
        self.bn1 = norm(CHANNELS[0])
        inputs = CHANNELS[0]
        for level, (width, blocks) in enumerate(zip(CHANNELS, BLOCKS[config.depth], strict=True)):
            outputs = width * EXPANSION[config.depth]
            block = BasicBlock if EXPANSION[config.depth] == 1 else Bottleneck
            stride = 1 if level == 0 else 2
            layer = [
                block(outputs if index else inputs, width, 1 if index else stride, norm) for index in range(blocks)
            ]
            self.add_module(f"layer{level + 1}", nn.Sequential(*layer))
            inputs = outputs
        self.pool = (
            SpatialSoftmax(inputs, config.maps)
            if config.pool == "spatial_softmax"
            else nn.Sequential(nn.AdaptiveAvgPool2d(1), nn.Flatten())
        )
        self.fc = nn.Linear(config.pooled, config.outputs) if config.outputs else nn.Identity()
        _initialise(self)

    def forward(self, images: Tensor) -> Tensor:
        """See :class:`juicer.policy.backbone.Backbone`."""
        x = functional.relu(self.bn1(self.conv1(images)))
        x = functional.max_pool2d(x, 3, 2, 1)
        for level in range(len(CHANNELS)):
            x = self.get_submodule(f"layer{level + 1}")(x)
        features: Tensor = self.fc(self.pool(x))
        return features

    def adapted(self, weights: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """State of this network by a file of torchvision, timm, R3M or VIP.

        The classifier is left out, and so is what group normalisation does not have, or does not take over from batch
        normalisation; it keeps its own, as the spatial softmax does where the file has none. A file without statistics
        of batches is taken for one of group normalisation.
        """
        own = self.state_dict()
        state = {name: value for name, value in weights.items() if not self._is_foreign(name)}
        is_of_batches = any(name.endswith(_STATISTICS) for name in weights)
        keeps_own = is_of_batches and not self.keeps_affine
        kept = {name: own[name] for name in own if keeps_own and _is_normalisation(name)}
        scratch = {name: own[name] for name in own if name.startswith("pool.")}
        return {**scratch, **state, **kept}

    def _is_foreign(self, name: str) -> bool:
        is_classifier = name.startswith("fc.") and isinstance(self.fc, nn.Identity)
        is_language = name.startswith(_LANGUAGE)
        is_statistic = name.endswith(_STATISTICS)
        return is_classifier or is_language or (is_statistic and not self.keeps_statistics)


def _convolution(inputs: int, outputs: int, kernel: int, stride: int = 1) -> nn.Conv2d:
    return nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2, bias=False)


def _group_norm(channels: int) -> nn.Module:
    return nn.GroupNorm(channels // CHANNELS_A_GROUP, channels)


def _skip(inputs: int, outputs: int, stride: int, norm: Norm) -> nn.Module:
    if stride == 1 and inputs == outputs:
        return nn.Identity()
    return nn.Sequential(_convolution(inputs, outputs, 1, stride), norm(outputs))


def _is_normalisation(name: str) -> bool:
    """Whether a weight is a scale or bias of normalisation: ``bn1.weight``, ``layer2.0.downsample.1.bias``."""
    owner = name.split(".")[-2]
    return owner.startswith("bn") or (owner == "1" and "downsample" in name)


def _initialise(network: nn.Module) -> None:
    """He's initialisation, as ResNets are trained from."""
    for module in network.modules():
        if isinstance(module, nn.Conv2d) and module.bias is None:
            nn.init.kaiming_normal_(module.weight, mode="fan_out", nonlinearity="relu")
