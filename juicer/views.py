"""Which image of a scene is meant: a camera, a part of what it sees, and a size. Data only: nothing is drawn here."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from juicer.config import StrictConfig
from juicer.episode import ArraySpec, Role

MAX_WIDTH, MAX_HEIGHT = 1280, 720
CAMERAS = FRONT_CAMERA, WRIST_CAMERA = "front", "wrist"

Share = Annotated[float, Field(ge=0, le=1)]


class Whole(StrictConfig):
    """All that a camera shows."""

    kind: Literal["whole"] = "whole"


class StaticCrop(StrictConfig):
    """A rectangle that stays where it is, as shares of the whole image, from its left and upper edge."""

    kind: Literal["static"] = "static"
    left: Share = 0.0
    right: Share = 1.0
    top: Share = 0.0
    bottom: Share = 1.0

    @model_validator(mode="after")
    def _has_an_inside(self) -> Self:
        if self.left >= self.right or self.top >= self.bottom:
            raise ValueError("left must be below right, and top below bottom")
        return self


class GazeCrop(StrictConfig):
    """A rectangle around a point near the end effector, placed by proprioception and the camera's calibration.

    It is what a crop of a camera with a higher resolution would show.
    """

    kind: Literal["gaze"] = "gaze"
    reach_m: float = Field(
        default=0.08, gt=0.001, le=1, description="half of the height that it shows at the point's distance"
    )
    below_m: float = Field(
        default=0.02, ge=-1, le=1, description="how far below the end effector, in the world, the point lies"
    )


class View(StrictConfig):
    """What an encoder is shown of a scene.

    The whole image of the front camera is 4:3, that of the wrist camera 16:9, each with a vertical field of view of
    42.56 degrees; in a size of another shape, it is squeezed.

    Attributes:
        renderer: What draws it, as ``module:class``: loaded by name, it counts for those results only whose
            configuration has a view.
    """

    renderer: ClassVar[str] = "juicer.imaging.renderer:ViewRenderer"

    camera: Literal["front", "wrist"]
    crop: Annotated[Whole | StaticCrop | GazeCrop, Field(discriminator="kind")] = Whole()
    width: int = Field(default=96, gt=0, le=MAX_WIDTH, description="pixels")
    height: int = Field(default=96, gt=0, le=MAX_HEIGHT, description="pixels")
    supersampling: Literal[1, 2, 3, 4] = Field(
        default=1, description="drawn so many times as wide and high, each pixel the mean of a square"
    )
    robot: Literal["primitives", "mesh"] = Field(
        default="primitives", description="how the robot looks; its mesh must be installed"
    )

    @model_validator(mode="after")
    def _wrist_has_no_gaze(self) -> Self:
        if self.camera == WRIST_CAMERA and isinstance(self.crop, GazeCrop):
            raise ValueError("the wrist camera moves with the end effector: give it a static crop instead of gaze")
        return self

    @property
    def name(self) -> str:
        """Name of its images among the arrays of an episode: the same for the same view, and for no other."""
        content = hashlib.sha256(self.model_dump_json().encode()).hexdigest()
        return f"{self.camera}_{self.crop.kind}_{content[:8]}"

    def __str__(self) -> str:
        """For people, e.g. ``front gaze 96x96``."""
        return f"{self.camera} {self.crop.kind} {self.width}x{self.height}"

    def observed(self, name: str = "") -> ImageSpec:
        """As an observation, by its own or another name."""
        return ImageSpec(name or self.name, (self.height, self.width, 3), "uint8", Role.OBSERVATION, self)

    @property
    def column(self) -> ArraySpec:
        """As a column derived from episodes."""
        return ArraySpec(self.name, (self.height, self.width, 3), "uint8", Role.DERIVED)


@dataclass(frozen=True)
class ImageSpec(ArraySpec):
    """Images ``(height, width, 3)`` of a view.

    Attributes:
        view: What they show.
    """

    view: View


def account_of(observations: Iterable[ArraySpec]) -> str:
    """What somebody who is shown these sees, for people: ``state``, ``images``, both, or ``proprioception`` alone."""
    specs = tuple(observations)
    images = any(isinstance(spec, ImageSpec) for spec in specs)
    poses = "part_poses" in {spec.name for spec in specs}
    told = {"images": images, "state": poses, "proprioception": not (images or poses)}
    return ", ".join(what for what, is_so in told.items() if is_so)
