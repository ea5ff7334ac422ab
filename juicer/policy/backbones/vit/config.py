"""Which vision transformer."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from juicer.policy.members import BackboneConfig

PATCH = 16
DEPTH = 12
WIDTHS = {"small": 384, "base": 768}
HEADS = {"small": 6, "base": 12}
_COLOURS = 3


class ViTConfig(BackboneConfig):
    """Vision transformer; names of its weights are those of timm, DINO and MAE, so that their files fit.

    What it yields is the class token behind the last normalisation.
    """

    network: ClassVar[str] = "juicer.policy.backbones.vit.network:ViT"
    is_of_one_size: ClassVar[bool] = True

    kind: Literal["vit"] = "vit"
    size: Literal["small", "base"] = Field(default="small", description="ViT-S/16 or ViT-B/16")

    def check_size(self, height: int, width: int) -> None:
        """See :class:`juicer.policy.members.BackboneConfig`."""
        if height % PATCH or width % PATCH:
            raise ValueError(f"a vit takes images whose sides are multiples of {PATCH} pixels, not {width}x{height}")

    @property
    def num_features(self) -> int:
        """See :class:`juicer.policy.members.BackboneConfig`."""
        return WIDTHS[self.size]

    def rough_parameters(self) -> int:
        """See :class:`juicer.policy.members.BackboneConfig`."""
        width = WIDTHS[self.size]
        return DEPTH * 12 * width**2 + _COLOURS * PATCH**2 * width
