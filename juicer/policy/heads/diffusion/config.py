"""How noise is added and removed, and by which network."""

from __future__ import annotations

from typing import ClassVar, Literal, Self

from pydantic import Field, model_validator

from juicer.policy.denoising import DenoisingConfig


class DiffusionConfig(DenoisingConfig):
    """Denoising diffusion over action chunks (DDPM training, DDIM sampling)."""

    network: ClassVar[str] = "juicer.policy.heads.diffusion.network:DiffusionHead"

    kind: Literal["diffusion"] = "diffusion"
    prediction: Literal["epsilon", "sample"] = Field(
        default="epsilon", description="what the denoiser predicts: the noise, or the clean chunk itself"
    )
    train_timesteps: int = Field(default=100, gt=0, le=10_000)
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
