"""Which images a policy looks at, and through which network."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from juicer.config import canonical_json
from juicer.policy.backbones.small_cnn.config import SmallCNNConfig
from juicer.policy.members import BACKBONES, BackboneConfig, EncoderConfig, Size
from juicer.views import View

MOST_VIEWS = 8

if TYPE_CHECKING:
    AnyBackbone = BackboneConfig
else:
    AnyBackbone = Annotated[BACKBONES.choice(), BACKBONES]

ViewName = Annotated[str, Field(pattern=r"^[a-z]\w*$", max_length=100)]


class ImagesConfig(EncoderConfig):
    """Views through a backbone, learned end to end or frozen."""

    network: ClassVar[str] = "juicer.policy.encoders.images.network:ImagesEncoder"

    kind: Literal["images"] = "images"
    views: dict[ViewName, View] = Field(
        default={"front": View(camera="front"), "wrist": View(camera="wrist")},
        min_length=1,
        max_length=MOST_VIEWS,
        description="what is looked at, by names of one's choice",
    )
    backbone: AnyBackbone = Field(
        default=SmallCNNConfig(),
        description="network from an image to features: one a view where it is trained, one for all where it is frozen",
    )
    frozen: bool = Field(default=False, description="whether the backbone stays as it is; projections learn anyway")
    projection: Size | None = Field(
        default=128, description="length of the learned linear map of each view's features; none if empty"
    )

    @model_validator(mode="after")
    def _backbone_takes_every_view(self) -> Self:
        for view in self.views.values():
            self.backbone.check_size(view.height, view.width)
        return self

    @property
    def learned_views(self) -> tuple[View, ...]:
        """See :class:`juicer.policy.members.EncoderConfig`."""
        return () if self.frozen else super().learned_views

    @property
    def fixed_parts(self) -> tuple[ImagesConfig, ...]:
        """What is frozen, a view each."""
        if not self.frozen:
            return ()
        return tuple(map(self._part, {view.name: view for view in self.views.values()}.values()))

    def column(self, view: View) -> str:
        """Name of the features of a view's images: the same for the same features, and for no others."""
        content = hashlib.sha256(canonical_json(self._part(view)).encode()).hexdigest()
        return f"{view.camera}_{self.backbone.kind}_{content[:8]}"

    def _part(self, view: View) -> Self:
        return self.model_copy(update={"views": {"only": view}, "projection": None})

    def rough_features(self) -> int:
        """See :class:`juicer.policy.members.EncoderConfig`."""
        return len(self.views) * (self.projection or self.backbone.rough_features())

    def rough_parameters(self) -> int:
        """See :class:`juicer.policy.members.EncoderConfig`."""
        backbones = 1 if self.frozen else len(self.views)
        projections = len(self.views) * (self.projection or 0) * self.backbone.rough_features()
        return backbones * self.backbone.rough_parameters() + projections
