"""What heads that walk from noise to an action chunk have in common, as configuration; free of torch."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from juicer.policy.denoisers.unet.config import UNetConfig
from juicer.policy.members import DENOISERS, DenoiserConfig, HeadConfig

if TYPE_CHECKING:
    AnyDenoiser = DenoiserConfig
else:
    AnyDenoiser = Annotated[DENOISERS.choice(), DENOISERS]


class DenoisingConfig(HeadConfig):
    """A head with a denoiser, which is asked once a step of the walk."""

    denoiser: AnyDenoiser = UNetConfig()
    inference_steps: int = Field(default=8, gt=0, le=1000)

    def check_horizon(self, pred_horizon: int) -> None:
        """See :class:`juicer.policy.members.ChunkConfig`."""
        self.denoiser.check_horizon(pred_horizon)

    def rough_parameters(self, chunk_size: int, condition_size: int) -> int:
        """See :class:`juicer.policy.members.ChunkConfig`."""
        return self.denoiser.rough_parameters(chunk_size, condition_size)
