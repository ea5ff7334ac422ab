"""Sizes of the U-Net."""

from __future__ import annotations

from typing import ClassVar, Literal, Self

from pydantic import Field, model_validator

from juicer.policy.members import DenoiserConfig, Size

LENGTH_MULTIPLE = 4
"""The U-Net halves the time axis twice."""


class UNetConfig(DenoiserConfig):
    """1-D U-Net over the action chunk; the defaults are the paper's, 69.12 M parameters."""

    network: ClassVar[str] = "juicer.policy.denoisers.unet.network:UNetDenoiser"

    kind: Literal["unet"] = "unet"
    channels: tuple[Size, Size, Size] = (256, 512, 1024)
    kernel_size: int = Field(default=5, gt=0, le=31)
    groups: Size = 8
    step_embedding: Size = Field(default=256, multiple_of=2)

    @model_validator(mode="after")
    def _layers_fit(self) -> Self:
        if self.kernel_size % 2 == 0:
            raise ValueError(f"kernel_size must be odd to keep the length of the chunk, got {self.kernel_size}")
        if any(channels % self.groups for channels in self.channels):
            raise ValueError(f"channels {self.channels} must be multiples of groups, got groups {self.groups}")
        return self

    def check_horizon(self, pred_horizon: int) -> None:
        """See :class:`juicer.policy.members.ChunkConfig`."""
        if pred_horizon % LENGTH_MULTIPLE:
            raise ValueError(f"a U-Net needs horizons.pred to be a multiple of {LENGTH_MULTIPLE}, got {pred_horizon}")

    def rough_parameters(self, chunk_size: int, condition_size: int) -> int:
        """See :class:`juicer.policy.members.ChunkConfig`."""
        low, middle, high = self.channels
        convolutions = 7 * low**2 + 6 * middle**2 + 7 * high**2 + 3 * low * middle + 3 * middle * high
        modulation = 8 * (low + middle + high) * (condition_size + self.step_embedding)
        return self.kernel_size * convolutions + modulation + 7 * (low**2 + middle**2)
