"""Which EfficientNet-Lite."""

from __future__ import annotations

from typing import ClassVar, Literal

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

    @property
    def num_features(self) -> int:
        """See :class:`juicer.policy.members.BackboneConfig`."""
        return FEATURES

    def rough_parameters(self) -> int:
        """See :class:`juicer.policy.members.BackboneConfig`."""
        return _PARAMETERS
