"""Which ResNet."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from juicer.policy.members import BackboneConfig, Size

CHANNELS = (64, 128, 256, 512)
BLOCKS = {18: (2, 2, 2, 2), 34: (3, 4, 6, 3), 50: (3, 4, 6, 3)}
EXPANSION = {18: 1, 34: 1, 50: 4}
"""Channels that a block yields, in multiples of those it computes with."""
_PARAMETERS = {18: 11_176_512, 34: 21_284_672, 50: 23_508_032}


class ResNetConfig(BackboneConfig):
    """ResNet; names of its weights are those of torchvision, R3M and VIP, so that their files fit."""

    network: ClassVar[str] = "juicer.policy.backbones.resnet.network:ResNet"

    kind: Literal["resnet"] = "resnet"
    depth: Literal[18, 34, 50] = 18
    norm: Literal["group", "batch"] = Field(
        default="group",
        description="group normalisation, a group for every 16 channels, or that of the weights' origin",
    )
    keep_affine: bool = Field(
        default=False,
        description="whether group normalisation takes over scale and bias of the batch normalisation in a file; the "
        "original does not",
    )
    pool: Literal["average", "spatial_softmax"] = Field(
        default="average", description="means of the last maps, or where some learned maps are bright"
    )
    maps: Size = Field(default=32, description="maps of the spatial softmax")
    outputs: Size | None = Field(
        default=None, description="length of a last linear layer, as VIP has one; none if empty"
    )

    @property
    def is_wholly_pretrained(self) -> bool:
        """See :class:`juicer.policy.members.BackboneConfig`; published files have no maps of a spatial softmax."""
        return self.weights is not None and self.pool == "average"

    @property
    def pooled(self) -> int:
        """Numbers behind the pooling."""
        return 2 * self.maps if self.pool == "spatial_softmax" else self.channels

    @property
    def channels(self) -> int:
        """Channels of the last block."""
        return CHANNELS[-1] * EXPANSION[self.depth]

    @property
    def num_features(self) -> int:
        """See :class:`juicer.policy.members.BackboneConfig`."""
        return self.outputs or self.pooled

    def rough_parameters(self) -> int:
        """See :class:`juicer.policy.members.BackboneConfig`."""
        pool = self.channels * self.maps if self.pool == "spatial_softmax" else 0
        return _PARAMETERS[self.depth] + pool + self.pooled * (self.outputs or 0)
