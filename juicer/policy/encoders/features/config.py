"""Which features of a state are shown, and how they are scaled."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from juicer.policy.members import EncoderConfig


class FeaturesConfig(EncoderConfig):
    """Which relative poses are shown, and how finely."""

    network: ClassVar[str] = "juicer.policy.encoders.features.network:FeatureEncoder"

    kind: Literal["features"] = "features"
    fine_scales_m: tuple[Annotated[float, Field(gt=0, le=10)], ...] = Field(
        default=(0.003, 0.01, 0.04), max_length=16, description="saturation lengths of offsets"
    )
    tilt_scale: float = Field(default=0.05, gt=0, le=10, description="saturation of the sine of a tilt")
    pairs: Literal["next", "all"] = Field(
        default="next", description="which are shown: that to be mounted next and the one before it, or all of them"
    )
    symmetry: bool = Field(
        default=True,
        description="whether parts are shown as they look: turned by a multiple of the turn after which they look the "
        "same, to where they are turned least",
    )
    normalisation: Literal["per_task", "together"] = Field(
        default="per_task",
        description="whether a policy for several tasks scales each task's features by that task's limits, or all of "
        "them by common limits, as in the original",
    )
    clip: float = Field(
        default=1.5, ge=1, le=1000, description="bound of normalised features, whose training range is [-1, 1]"
    )
