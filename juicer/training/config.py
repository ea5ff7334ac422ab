"""How a policy is trained, as configuration; free of torch like :mod:`juicer.policy.config`."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from juicer.config import StrictConfig
from juicer.policy.config import MOST_HORIZON

MOST_STEPS = 100_000_000
Steps = Annotated[int, Field(gt=0, le=MOST_STEPS)]
"""Steps of training."""


class PhysicalStateNoise(StrictConfig):
    """Noise in metres and radians, as the paper describes it."""

    kind: Literal["physical"] = "physical"
    probability: float = Field(default=0.2, ge=0, le=1, description="share of the samples of every batch")
    position_m: float = Field(default=0.01, ge=0, le=10, description="standard deviation on each axis")
    rotation_rad: float = Field(default=0.1, ge=0, le=10, description="standard deviation of each Euler angle")


class OriginalStateNoise(StrictConfig):
    """Noise as the original's code adds it: to the *normalised* state.

    0.01 normalised units are 2 to 3 mm, and the rotated 6D numbers leave the normalised scale.
    """

    kind: Literal["original"] = "original"
    probability: float = Field(default=0.2, ge=0, le=1, description="share of the samples of every batch")
    position: float = Field(default=0.01, ge=0, le=10, description="standard deviation on each axis, normalised units")
    rotation_rad: float = Field(default=0.1, ge=0, le=10, description="standard deviation of each Euler angle")


StateNoise = PhysicalStateNoise | OriginalStateNoise


class WindowConfig(StrictConfig):
    """How windows of T_p actions are cut at the end of an episode."""

    back_padding: int = Field(
        default=7,
        ge=0,
        le=MOST_HORIZON,
        description="times the last action may be repeated to complete a window; an episode of length L gives "
        "L + T_o + back_padding - T_p windows (the original: 7, and 0 with augmentation, which loses short snippets)",
    )
    learn_padding: bool = Field(
        default=True, description="whether repeated actions are targets too, or left out of the loss"
    )


class TrainingConfig(StrictConfig):
    """Optimisation; the defaults are the paper's (Table III) where it speaks."""

    steps: Steps = 160_000
    batch_size: int = Field(default=256, gt=0, le=65_536)
    learning_rate: float = Field(default=1e-4, gt=0, le=10)
    weight_decay: float = Field(default=1e-6, ge=0, le=10)
    warmup_steps: int = Field(
        default=500, ge=0, le=MOST_STEPS, description="linear rise of the learning rate; a cosine to zero follows"
    )
    ema_decay: float | None = Field(default=None, gt=0, lt=1, description="the moving average acts, if there is one")
    precision: Literal["fp32", "bf16", "auto"] = Field(
        default="fp32", description="arithmetic of the network; 'auto' is bf16 where the processor has it"
    )
    memory_format: Literal["contiguous", "channels_last"] = Field(
        default="contiguous",
        description="how weights of image networks lie in memory; 'channels_last' is quicker on most GPUs",
    )
    compile: bool = Field(
        default=False,
        description="whether torch.compile makes one program of the network: minutes at the start, then quicker steps",
    )
    threads: int = Field(default=1, gt=0, le=1024)
    windows: WindowConfig = WindowConfig()
    state_noise: Annotated[StateNoise, Field(discriminator="kind")] | None = None
    validation_fraction: float = Field(default=0.05, ge=0, lt=1, description="share of the episodes held out")
    validate_every: Steps = Field(default=1000, description="steps")
    report_every: Steps = Field(default=50, description="steps")
    save_every: Steps = Field(
        default=500, description="steps between saves of the state to resume from; it is saved once a minute anyway"
    )

    @model_validator(mode="after")
    def _warmup_ends(self) -> Self:
        if self.warmup_steps >= self.steps:
            raise ValueError(f"warmup_steps must be below steps, got {self.warmup_steps} >= {self.steps}")
        return self
