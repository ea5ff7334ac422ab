"""Which EfficientNet-Lite."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from juicer.policy.members import BackboneConfig, Colour

FEATURES = 1280
_PARAMETERS = 3_371_008


class EfficientNetLiteConfig(BackboneConfig):
    """EfficientNet-Lite0, means of its last maps; its normalisation is that of batches."""

    network: ClassVar[str] = "juicer.policy.backbones.efficientnet_lite.network:EfficientNetLite"
    pixel_mean: ClassVar[Colour] = (127 / 255, 127 / 255, 127 / 255)
    pixel_std: ClassVar[Colour] = (128 / 255, 128 / 255, 128 / 255)

    kind: Literal["efficientnet_lite"] = "efficientnet_lite"
    variant: Literal["lite0"] = "lite0"
    pixels: Literal["minus_one_to_one"] = Field(
        default="minus_one_to_one",
        description="what it is shown of dark to bright; stored with what has learned from it, as it once was another",
    )

    def check_stored(self) -> None:
        """See :class:`juicer.policy.members.BackboneConfig`."""
        if "pixels" not in self.model_fields_set:
            raise ValueError("it may be of the time when EfficientNet-Lite0 was shown pixels 2.2 times too strong")

    @property
    def num_features(self) -> int:
        """See :class:`juicer.policy.members.BackboneConfig`."""
        return FEATURES

    def rough_parameters(self) -> int:
        """See :class:`juicer.policy.members.BackboneConfig`."""
        return _PARAMETERS
