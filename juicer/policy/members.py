"""The families that a policy is made of, as configuration; free of torch."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field

from juicer.config import models_in
from juicer.policy.family import Family, MemberConfig
from juicer.policy.pretrained.config import WeightsField
from juicer.views import View

MOST_BLOCKS = 64
TYPICAL_FEATURES = 256
"""Numbers that an encoder yields of a step, where it does not say."""

Size = Annotated[int, Field(gt=0, le=16_384)]
"""Width of a layer."""
Blocks = Annotated[int, Field(gt=0, le=MOST_BLOCKS)]
"""Number of layers."""
Colour = tuple[float, float, float]
"""Red, green and blue."""


class EncoderConfig(MemberConfig):
    """How some observations become a part of the condition; see :class:`juicer.policy.encoder.ObservationEncoder`."""

    @property
    def views_seen(self) -> tuple[View, ...]:
        """Views that it names."""
        return tuple(model for model in models_in(self) if isinstance(model, View))

    @property
    def learned_views(self) -> tuple[View, ...]:
        """Views of which it is shown images in training: all, unless it learns from something else."""
        return self.views_seen

    @property
    def fixed_parts(self) -> tuple[EncoderConfig, ...]:
        """Encoders that learn nothing and whose results it is shown in training: computed once for all who need them.

        What such an encoder prepares of what it sees are the columns that it observes in training.
        """
        return ()

    def rough_features(self) -> int:
        """Numbers that it yields of a step, roughly: for the estimate of a policy's size."""
        return TYPICAL_FEATURES

    def rough_parameters(self) -> int:
        """Its weights to within a few per cent, or 0 if that is not known before it is built."""
        return 0


class BackboneConfig(MemberConfig):
    """A network from images to features; see :class:`juicer.policy.backbone.Backbone`.

    Attributes:
        pixel_mean: Of red, green and blue, in shares of full brightness: what is taken off before the network.
        pixel_std: What they are divided by then.
        is_of_one_size: Whether what it has learned belongs to one size of image.
    """

    pixel_mean: ClassVar[Colour] = (0.485, 0.456, 0.406)
    pixel_std: ClassVar[Colour] = (0.229, 0.224, 0.225)
    is_of_one_size: ClassVar[bool] = False

    weights: WeightsField | None = Field(
        default=None, description="what it starts from: published weights by name, or a file; random if empty"
    )

    @property
    def is_wholly_pretrained(self) -> bool:
        """Whether nothing in it starts with random weights."""
        return self.weights is not None

    def described(self) -> str:
        """For people: its kind, and the settings that are not the usual ones."""
        settings = self.model_dump(exclude={"kind", "weights"}, exclude_defaults=True)
        return " ".join([self.kind, *(f"{name}={value}" for name, value in settings.items())])

    def check_size(self, height: int, width: int) -> None:
        """Refuse images of a size that the network cannot take.

        Raises:
            ValueError: With a sentence that says why.
        """

    def check_stored(self) -> None:
        """Refuse a configuration that lies beside learned weights if these were learned by another network.

        What is stored says every setting, the usual ones too: one that is not there came after the weights.

        Raises:
            ValueError: With a sentence that says what was different.
        """

    @property
    def num_features(self) -> int:
        """Length C of its features."""
        raise NotImplementedError(f"{type(self).__name__} does not say how many features it yields")

    def rough_parameters(self) -> int:
        """Its weights to within a few per cent, or 0 if that is not known before it is built."""
        return 0


class ChunkConfig(MemberConfig):
    """A network that yields action chunks."""

    def check_horizon(self, pred_horizon: int) -> None:
        """Refuse a number of predicted actions that the network cannot have.

        Raises:
            ValueError: With a sentence that says why.
        """

    def rough_parameters(self, chunk_size: int, condition_size: int) -> int:
        """Learned weights to within a few per cent, or 0 if that is not known before the network is built.

        Args:
            chunk_size: Numbers in an action chunk.
            condition_size: Numbers that the network is shown.
        """
        return 0


class HeadConfig(ChunkConfig):
    """How actions are chosen; see :class:`juicer.policy.head.ActionHead`."""


class DenoiserConfig(ChunkConfig):
    """What removes noise from an action chunk; see :class:`juicer.policy.denoiser.Denoiser`."""


ENCODERS = Family(EncoderConfig, "juicer.policy.encoders", "juicer.encoders")
BACKBONES = Family(BackboneConfig, "juicer.policy.backbones", "juicer.backbones")
HEADS = Family(HeadConfig, "juicer.policy.heads", "juicer.heads")
DENOISERS = Family(DenoiserConfig, "juicer.policy.denoisers", "juicer.denoisers")


def rough_mlp(width: int, blocks: int, ends: int) -> int:
    """Weights of a residual MLP with two layers a block and so many numbers at both its ends."""
    return width * (2 * blocks * width + ends)
