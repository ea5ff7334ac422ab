"""How proprioception is scaled."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from juicer.episode import PROPRIOCEPTION_SIZE
from juicer.policy.members import EncoderConfig


class ProprioceptionConfig(EncoderConfig):
    """The sixteen numbers of proprioception, scaled to the limits of the training data."""

    network: ClassVar[str] = "juicer.policy.encoders.proprioception.network:ProprioceptionEncoder"

    kind: Literal["proprioception"] = "proprioception"
    clip: float = Field(
        default=1.5, ge=1, le=1000, description="bound of normalised numbers, whose training range is [-1, 1]"
    )

    def rough_features(self) -> int:
        """See :class:`juicer.policy.members.EncoderConfig`."""
        return PROPRIOCEPTION_SIZE
