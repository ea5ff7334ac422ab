"""What a policy reads off images instead of being told, and how that is learned beforehand."""

from __future__ import annotations

from typing import ClassVar, Literal, Self

from pydantic import Field, model_validator

from juicer.config import StrictConfig, short_hash
from juicer.displacements import Displacements
from juicer.policy.backbones.patch_cnn.config import PatchCNNConfig
from juicer.policy.encoders.features.config import FeaturesConfig
from juicer.policy.encoders.images.config import MOST_VIEWS, AnyBackbone, ViewName
from juicer.policy.members import EncoderConfig, Size
from juicer.views import GazeCrop, StaticCrop, View


class EstimatorConfig(StrictConfig):
    """What the estimator sees, what it is made of, and how it learns."""

    views: dict[ViewName, View] = Field(
        default={
            "front": View(
                camera="front",
                crop=StaticCrop(left=0.1, right=0.9, top=0.35, bottom=0.85),
                width=128,
                height=64,
            ),
            "gaze": View(camera="front", crop=GazeCrop(reach_m=0.06, below_m=0.04)),
            # Its lowest seventh shows nothing but the hand.
            "wrist": View(camera="wrist", crop=StaticCrop(bottom=0.85), supersampling=2),
        },
        min_length=1,
        max_length=MOST_VIEWS,
    )
    backbone: AnyBackbone = Field(default=PatchCNNConfig(), description="network from an image to features, one a view")
    width: Size = Field(default=512, description="of the layers that bring the views together")
    states: int = Field(default=32_000, gt=0, le=10_000_000, description="displaced states that are drawn")
    near_critical: float = Field(default=0.5, ge=0, le=1, description="share of them from around critical states")
    displacements: Displacements = Displacements()
    steps: int = Field(default=6000, gt=0, le=100_000_000)
    batch_size: int = Field(default=64, gt=0, le=65_536)
    learning_rate: float = Field(default=2e-3, gt=0, le=10)
    precision: Literal["fp32", "bf16", "auto"] = Field(
        default="auto", description="arithmetic in which it learns; 'auto' is bf16 where the processor has it"
    )
    threads: int = Field(
        default=2,
        gt=0,
        le=1024,
        description="each of which takes a part of a batch; one, where batches change statistics of the network",
    )
    validation_fraction: float = Field(default=0.1, gt=0, lt=1, description="share of the demonstrations held out")

    @model_validator(mode="after")
    def _views_can_be_seen(self) -> Self:
        if len({view.name for view in self.views.values()}) < len(self.views):
            raise ValueError("two views are the same; leave one out")
        for view in self.views.values():
            self.backbone.check_size(view.height, view.width)
        return self


class EstimatedConfig(EncoderConfig):
    """Features of a state, estimated from images and proprioception by a network that has learned beforehand."""

    network: ClassVar[str] = "juicer.policy.encoders.estimated.network:EstimatedEncoder"

    kind: Literal["estimated"] = "estimated"
    features: FeaturesConfig = FeaturesConfig()
    estimator: EstimatorConfig = EstimatorConfig()

    @property
    def learned_views(self) -> tuple[View, ...]:
        """None: a policy learns from what was estimated."""
        return ()

    @property
    def fixed_parts(self) -> tuple[EstimatedConfig, ...]:
        """All of it."""
        return (self,)

    @property
    def column(self) -> str:
        """Name of the estimates: the same for estimators of the same configuration, and for no others."""
        return f"{self.kind}_{short_hash(self)}"

    def rough_features(self) -> int:
        """See :class:`juicer.policy.members.EncoderConfig`."""
        return self.features.rough_features()

    def rough_parameters(self) -> int:
        """Those of one estimator; a policy for several tasks has as many estimators."""
        estimator = self.estimator
        seen = len(estimator.views) * estimator.backbone.num_features
        return len(estimator.views) * estimator.backbone.rough_parameters() + estimator.width * (
            seen + estimator.width // 2
        )
