"""Sizes of the small convolutional network."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from juicer.policy.members import BackboneConfig, Colour

SMALLEST = 8
"""Pixels of an image's side: three layers halve it."""
_KERNEL, _STEM_KERNEL = 3 * 3, 5 * 5
_COLOURS = 3

Channels = Annotated[int, Field(gt=0, le=1024)]
Maps = Annotated[int, Field(ge=0, le=1024)]


class SmallCNNConfig(BackboneConfig):
    """Residual network without normalisation layers, which would take half of its time on a CPU.

    What it yields says where something is (spatial softmax, at a quarter and an eighth of the image's size) and what
    (means of the cells of a coarse grid).
    """

    network: ClassVar[str] = "juicer.policy.backbones.small_cnn.network:SmallCNN"
    pixel_mean: ClassVar[Colour] = (0.5, 0.5, 0.5)
    pixel_std: ClassVar[Colour] = (0.25, 0.25, 0.25)

    kind: Literal["small_cnn"] = "small_cnn"
    stem: Channels = Field(default=24, description="channels at half of the image's size")
    quarter: Channels = Field(default=32, description="channels at a quarter of its size")
    eighth: Channels = Field(default=64, description="channels at an eighth of its size, in two blocks")
    quarter_maps: Maps = Field(default=24, description="maps at a quarter whose place is told; none if 0")
    eighth_maps: Maps = Field(default=32, description="maps at an eighth whose place is told; none if 0")
    grid: int = Field(default=3, gt=0, le=16, description="cells of the coarse grid on each side")

    def check_size(self, height: int, width: int) -> None:
        """See :class:`juicer.policy.members.BackboneConfig`."""
        if min(height, width) < SMALLEST:
            raise ValueError(f"a small_cnn takes images of at least {SMALLEST}x{SMALLEST} pixels")

    def rough_features(self) -> int:
        """Exactly, as it happens."""
        return 2 * (self.quarter_maps + self.eighth_maps) + self.eighth * self.grid**2

    def rough_parameters(self) -> int:
        """See :class:`juicer.policy.members.BackboneConfig`."""
        stem, quarter, eighth = self.stem, self.quarter, self.eighth
        blocks = quarter * (stem + quarter) + eighth * (quarter + eighth) + 2 * eighth**2
        skips = stem * quarter + quarter * eighth
        maps = quarter * self.quarter_maps + eighth * self.eighth_maps
        return _COLOURS * _STEM_KERNEL * stem + _KERNEL * blocks + skips + maps
