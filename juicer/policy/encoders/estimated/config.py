"""What a policy reads off images instead of being told, and how that is learned beforehand."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from juicer.config import StrictConfig
from juicer.displacements import Displacements
from juicer.policy.encoders.features.config import FeaturesConfig
from juicer.policy.members import Blocks, EncoderConfig, Size
from juicer.views import GazeCrop, StaticCrop, View

MOST_VIEWS = 8
ViewName = Annotated[str, Field(pattern=r"^[a-z]\w*$", max_length=40)]


class CnnConfig(StrictConfig):
    """A small convolutional network: dense convolutions at a quarter and an eighth of the image's size."""

    width: tuple[Size, Size] = Field(default=(48, 64), description="channels at either size")
    blocks: tuple[Blocks, Blocks] = Field(default=(1, 2), description="residual blocks at either size")
    points: Size = Field(default=32, description="maps at either size whose centre of mass is read")


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
            "gaze": View(camera="front", crop=GazeCrop()),
            "wrist": View(camera="wrist", supersampling=2),
        },
        min_length=1,
        max_length=MOST_VIEWS,
    )
    cnn: CnnConfig = CnnConfig()
    width: Size = Field(default=512, description="of the layers that bring the views together")
    states: int = Field(default=24_000, gt=0, le=10_000_000, description="displaced states that are drawn")
    near_critical: float = Field(default=0.5, ge=0, le=1, description="share of them from around critical states")
    displacements: Displacements = Displacements()
    steps: int = Field(default=4000, gt=0, le=100_000_000)
    batch_size: int = Field(default=128, gt=0, le=65_536)
    learning_rate: float = Field(default=2e-3, gt=0, le=10)
    threads: int = Field(default=2, gt=0, le=1024)
    validation_fraction: float = Field(default=0.1, gt=0, lt=1, description="share of the demonstrations held out")

    @model_validator(mode="after")
    def _views_differ(self) -> Self:
        if len({view.name for view in self.views.values()}) < len(self.views):
            raise ValueError("two views are the same; leave one out")
        return self


class EstimatedConfig(EncoderConfig):
    """Features of a state, true ones in training, estimated from images and proprioception when acting."""

    network: ClassVar[str] = "juicer.policy.encoders.estimated.network:EstimatedEncoder"

    kind: Literal["estimated"] = "estimated"
    features: FeaturesConfig = FeaturesConfig()
    estimator: EstimatorConfig = EstimatorConfig()
