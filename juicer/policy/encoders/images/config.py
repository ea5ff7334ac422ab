"""Which images a policy looks at, and through which network."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from juicer.config import StrictConfig, short_hash
from juicer.policy.backbones.patch_cnn.config import PatchCNNConfig
from juicer.policy.image_augmentation.config import ImageAugmentation
from juicer.policy.members import BACKBONES, BackboneConfig, EncoderConfig, Size
from juicer.views import MAX_HEIGHT, MAX_WIDTH, View

MOST_VIEWS = 8

if TYPE_CHECKING:
    AnyBackbone = BackboneConfig
else:
    AnyBackbone = Annotated[BACKBONES.choice(), BACKBONES]

ViewName = Annotated[str, Field(pattern=r"^[a-z]\w*$", max_length=100)]


class CropSize(StrictConfig):
    """Size of a part of an image, pixels."""

    width: int = Field(gt=0, le=MAX_WIDTH)
    height: int = Field(gt=0, le=MAX_HEIGHT)


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
        default=PatchCNNConfig(),
        description="network from an image to features: one a view where it is trained, one for all where it is frozen",
    )
    frozen: bool = Field(default=False, description="whether the backbone stays as it is; projections learn anyway")
    projection: Size | None = Field(
        default=128, description="length of the learned linear map of each view's features; none if empty"
    )

    crops: dict[ViewName, CropSize] = Field(
        default={},
        max_length=MOST_VIEWS,
        description="of these views only a part of this size goes through the backbone: anywhere in training, another "
        "one for each sample, and the middle when acting or where the backbone is frozen",
    )
    augmentation: ImageAugmentation | None = Field(
        default=None, description="how colours and sharpness vary in training; not at all if empty"
    )

    @model_validator(mode="after")
    def _backbone_takes_every_view(self) -> Self:
        if strange := sorted(self.crops.keys() - self.views.keys()):
            raise ValueError(f"crops name '{strange[0]}', which is none of the views: {', '.join(self.views)}")
        for name, view in self.views.items():
            height, width = self.seen_size(name)
            if height > view.height or width > view.width:
                raise ValueError(f"the crop of '{name}' is larger than its {view.width}x{view.height} pixels")
            self.backbone.check_size(height, width)
            if self.augmentation is not None and min(height, width) <= self.augmentation.blur_kernel // 2:
                raise ValueError(f"the blur of '{name}' reaches beyond its {width}x{height} pixels")
        return self

    @model_validator(mode="after")
    def _frozen_sees_what_is(self) -> Self:
        if self.frozen and self.augmentation is not None:
            raise ValueError("what is frozen sees every image once, before the training: leave out augmentation")
        return self

    @model_validator(mode="after")
    def _frozen_is_not_random(self) -> Self:
        # Features are computed once and the policy acts through another copy of the network: both come from one file.
        if self.frozen and not self.backbone.is_wholly_pretrained:
            raise ValueError(
                f"a frozen backbone keeps the weights that it starts from, and those of {self.backbone.described()} "
                "are random, all or some of them: take one that comes from a file of weights as a whole, or train it "
                "(frozen: false)"
            )
        return self

    @model_validator(mode="after")
    def _one_for_all_sees_one_size(self) -> Self:
        sizes = {self.seen_size(name) for name in self.views}
        if self.frozen and self.backbone.is_of_one_size and len(sizes) > 1:
            raise ValueError(f"a frozen {self.backbone.kind} is one for all views: give these one size")
        return self

    def seen_size(self, name: str) -> tuple[int, int]:
        """Height and width of what the backbone sees of a view."""
        seen = self.crops.get(name, self.views[name])
        return seen.height, seen.width

    @property
    def learned_views(self) -> tuple[View, ...]:
        """See :class:`juicer.policy.members.EncoderConfig`."""
        return () if self.frozen else super().learned_views

    @property
    def fixed_parts(self) -> tuple[ImagesConfig, ...]:
        """What is frozen, a view each."""
        if not self.frozen:
            return ()
        return tuple({self.column(name): self._part(name) for name in self.views}.values())

    def column(self, name: str) -> str:
        """Name of the features of a view: the same for the same features, and for no others."""
        return f"{self.views[name].camera}_{self.backbone.kind}_{short_hash(self._part(name))}"

    def _part(self, name: str) -> Self:
        crops = {"only": self.crops[name]} if name in self.crops else {}
        return self.model_copy(update={"views": {"only": self.views[name]}, "crops": crops, "projection": None})

    def rough_features(self) -> int:
        """See :class:`juicer.policy.members.EncoderConfig`."""
        return len(self.views) * (self.projection or self.backbone.num_features)

    def rough_parameters(self) -> int:
        """See :class:`juicer.policy.members.EncoderConfig`."""
        backbones = 1 if self.frozen else len(self.views)
        projections = len(self.views) * (self.projection or 0) * self.backbone.num_features
        return backbones * self.backbone.rough_parameters() + projections
