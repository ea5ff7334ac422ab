"""The three families that a policy is made of, as configuration; free of torch."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from juicer.config import models_in
from juicer.policy.family import Family, MemberConfig
from juicer.views import View

MOST_BLOCKS = 64

Size = Annotated[int, Field(gt=0, le=16_384)]
"""Width of a layer."""
Blocks = Annotated[int, Field(gt=0, le=MOST_BLOCKS)]
"""Number of layers."""


class EncoderConfig(MemberConfig):
    """How some observations become a part of the condition; see :class:`juicer.policy.encoder.ObservationEncoder`."""

    @property
    def learned_views(self) -> tuple[View, ...]:
        """Views of which it is shown images in training: all that it names, unless it learns from something else."""
        return tuple(model for model in models_in(self) if isinstance(model, View))


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
HEADS = Family(HeadConfig, "juicer.policy.heads", "juicer.heads")
DENOISERS = Family(DenoiserConfig, "juicer.policy.denoisers", "juicer.denoisers")


def rough_mlp(width: int, blocks: int, ends: int) -> int:
    """Weights of a residual MLP with two layers a block and so many numbers at both its ends."""
    return width * (2 * blocks * width + ends)
