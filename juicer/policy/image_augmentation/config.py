"""How images vary in training."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from juicer.config import StrictConfig

Jitter = Annotated[float, Field(ge=0, le=1)]
Sigma = Annotated[float, Field(gt=0, le=100)]


class ImageAugmentation(StrictConfig):
    """Colour jitter, then blur; the defaults are the paper's. Every sample has a draw of its own."""

    brightness: Jitter = Field(default=0.3, description="factors are drawn from 1 - this to 1 + this")
    contrast: Jitter = Field(default=0.3, description="likewise")
    saturation: Jitter = Field(default=0.3, description="likewise")
    hue: float = Field(default=0.3, ge=0, le=0.5, description="turns of the colour circle, either way")
    blur_kernel: int = Field(default=5, ge=1, le=31, description="pixels across; 1 for no blur")
    blur_sigma: tuple[Sigma, Sigma] = Field(default=(0.1, 5.0), description="pixels, least and most")

    @model_validator(mode="after")
    def _blur_is_possible(self) -> Self:
        if self.blur_kernel % 2 == 0:
            raise ValueError(f"blur_kernel must be odd, got {self.blur_kernel}")
        if self.blur_sigma[0] > self.blur_sigma[1]:
            raise ValueError(f"blur_sigma must rise, got {self.blur_sigma[0]} to {self.blur_sigma[1]}")
        return self
