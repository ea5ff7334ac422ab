"""In how many jumps noise becomes an action chunk, and by which network."""

from __future__ import annotations

from typing import ClassVar, Literal, Self

from pydantic import Field, model_validator

from juicer.policy.denoising import DenoisingConfig


class FlowConfig(DenoisingConfig):
    """Flow from noise to action chunks that takes a single step, or a few (shortcut model)."""

    network: ClassVar[str] = "juicer.policy.heads.flow.network:FlowHead"

    kind: Literal["flow"] = "flow"
    inference_steps: int = Field(default=1, gt=0, le=1024, description="1, 2, 4 ... up to finest_steps")
    finest_steps: int = Field(
        default=8, gt=1, le=1024, description="steps of the walk that is learned from data alone, a power of two"
    )
    longer_jumps: float = Field(
        default=0.25, ge=0, le=1, description="share of a batch that learns to do two steps in one"
    )

    @model_validator(mode="after")
    def _steps_fit(self) -> Self:
        for name in ("finest_steps", "inference_steps"):
            if (steps := getattr(self, name)).bit_count() != 1:
                raise ValueError(f"{name} must be a power of two, got {steps}")
        if self.inference_steps > self.finest_steps:
            raise ValueError(
                f"inference_steps must not exceed finest_steps, got {self.inference_steps} > {self.finest_steps}"
            )
        return self
