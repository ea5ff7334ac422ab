"""Sizes of the convolutional network that begins with patches."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from juicer.policy.members import BackboneConfig, Colour

PATCH = 4
"""Pixels a side that become one."""
_KERNEL, _COLOURS = 3 * 3, 3

Channels = Annotated[int, Field(gt=0, le=1024)]
NumBlocks = Annotated[int, Field(ge=0, le=64)]


class PatchCNNConfig(BackboneConfig):
    """Residual network at a quarter and an eighth of the image's size, without normalisation layers.

    Patches of 4x4 pixels become channels at once, and from there on every convolution is dense and has dozens of
    channels. Processors with bfloat16 do five times as much of that in a second as of convolutions with few channels at
    full size, and thirty times as much as of depthwise ones.
    """

    network: ClassVar[str] = "juicer.policy.backbones.patch_cnn.network:PatchCNN"
    pixel_mean: ClassVar[Colour] = (0.5, 0.5, 0.5)
    pixel_std: ClassVar[Colour] = (0.25, 0.25, 0.25)

    kind: Literal["patch_cnn"] = "patch_cnn"
    quarter: Channels = Field(default=48, description="channels at a quarter of the image's size")
    quarter_blocks: NumBlocks = 1
    eighth: Channels = Field(default=64, description="channels at an eighth of its size")
    eighth_blocks: NumBlocks = 2
    maps: Channels = Field(default=32, description="maps at either size whose place is told")
    grid: int = Field(default=3, gt=0, le=16, description="cells of the coarse grid on each side")

    def check_size(self, height: int, width: int) -> None:
        """See :class:`juicer.policy.members.BackboneConfig`."""
        if height % (2 * PATCH) or width % (2 * PATCH):
            raise ValueError(f"a patch_cnn takes images whose height and width are multiples of {2 * PATCH} pixels")

    @property
    def num_features(self) -> int:
        """See :class:`juicer.policy.members.BackboneConfig`."""
        return 4 * self.maps + self.eighth * self.grid**2

    def rough_parameters(self) -> int:
        """See :class:`juicer.policy.members.BackboneConfig`."""
        quarter, eighth = self.quarter, self.eighth
        stem, down = _COLOURS * PATCH**2 * quarter, quarter * eighth
        blocks = 2 * self.quarter_blocks * quarter**2 + 2 * self.eighth_blocks * eighth**2
        return _KERNEL * (stem + down + blocks) + (quarter + eighth) * self.maps
