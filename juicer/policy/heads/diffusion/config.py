"""How noise is added and removed, and by which network."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from juicer.policy.denoisers.unet.config import UNetConfig
from juicer.policy.members import DENOISERS, DenoiserConfig, HeadConfig

if TYPE_CHECKING:
    AnyDenoiser = DenoiserConfig
else:
    AnyDenoiser = Annotated[DENOISERS.choice(), DENOISERS]


class DiffusionConfig(HeadConfig):
    """Denoising diffusion over action chunks (DDPM training, DDIM sampling)."""

    network: ClassVar[str] = "juicer.policy.heads.diffusion.network:DiffusionHead"

    kind: Literal["diffusion"] = "diffusion"
    denoiser: AnyDenoiser = UNetConfig()
    prediction: Literal["epsilon", "sample"] = Field(
        default="epsilon", description="what the denoiser predicts: the noise, or the clean chunk itself"
    )
    train_timesteps: int = Field(default=100, gt=0, le=10_000)
    inference_steps: int = Field(default=8, gt=0, le=1000)
    spacing: Literal["leading", "trailing"] = Field(
        default="leading",
        description="noise levels visited: 'leading' starts below full noise as the original does, 'trailing' at it",
    )

    @model_validator(mode="after")
    def _steps_fit(self) -> Self:
        if self.inference_steps > self.train_timesteps:
            raise ValueError(
                f"inference_steps must not exceed train_timesteps, got {self.inference_steps} > {self.train_timesteps}"
            )
        return self

    def check_horizon(self, pred_horizon: int) -> None:
        """See :class:`juicer.policy.members.ChunkConfig`."""
        self.denoiser.check_horizon(pred_horizon)

    def rough_parameters(self, chunk_size: int, condition_size: int) -> int:
        """See :class:`juicer.policy.members.ChunkConfig`."""
        return self.denoiser.rough_parameters(chunk_size, condition_size)
