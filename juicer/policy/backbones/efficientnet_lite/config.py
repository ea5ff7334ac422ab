"""Which EfficientNet-Lite."""

from __future__ import annotations

from typing import ClassVar, Literal

from juicer.policy.members import BackboneConfig

FEATURES = 1280
_PARAMETERS = 3_371_008


class EfficientNetLiteConfig(BackboneConfig):
    """EfficientNet-Lite0, means of its last maps; its normalisation is that of batches."""

    network: ClassVar[str] = "juicer.policy.backbones.efficientnet_lite.network:EfficientNetLite"

    kind: Literal["efficientnet_lite"] = "efficientnet_lite"
    variant: Literal["lite0"] = "lite0"

    @property
    def num_features(self) -> int:
        """See :class:`juicer.policy.members.BackboneConfig`."""
        return FEATURES

    def rough_parameters(self) -> int:
        """See :class:`juicer.policy.members.BackboneConfig`."""
        return _PARAMETERS
