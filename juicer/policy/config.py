"""What a policy is made of, as configuration; free of torch, so that commands which only read it start fast."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from juicer.config import StrictConfig
from juicer.episode import ACTION_SIZE

UNET_LENGTH_MULTIPLE = 4
"""The U-Net halves the time axis twice."""

MOST_PARAMETERS = 500_000_000
"""Learned weights of the largest policy: 2 GB in fp32, seven times the paper's."""

MOST_PARTS, MOST_PAIRS, MOST_TARGETS, MOST_TASKS = 64, 32, 16, 16
MOST_HORIZON = 1024
MOST_BLOCKS = 64
_TYPICAL_FEATURES = 256
"""Numbers that a network is shown of a step, for the estimate of its size."""

Size = Annotated[int, Field(gt=0, le=16_384)]
"""Width of a layer."""


class StateObservationConfig(StrictConfig):
    """Which relative poses are shown, and how finely."""

    fine_scales_m: tuple[Annotated[float, Field(gt=0, le=10)], ...] = Field(
        default=(0.003, 0.01, 0.04), max_length=16, description="saturation lengths of offsets"
    )
    tilt_scale: float = Field(default=0.05, gt=0, le=10, description="saturation of the sine of a tilt")
    pairs: Literal["next", "all"] = Field(
        default="next", description="which are shown: that to be mounted next and the one before it, or all of them"
    )
    clip: float = Field(
        default=1.5, ge=1, le=1000, description="bound of normalised features, whose training range is [-1, 1]"
    )


Coordinate = Annotated[float, Field(ge=-10, le=10)]
Target = tuple[Coordinate, Coordinate, Coordinate, Coordinate, Coordinate, Coordinate, Coordinate]


class PairSpec(StrictConfig):
    """Two parts that are to be joined, the second inserted along its own y axis and screwed about it.

    Attributes:
        first: Index of the part that receives.
        second: Index of the part that is moved.
        target: Assembled pose ``(7,)`` of the second part in the frame of the first: metres, quaternion wxyz.
        also_at: Other poses at which it counts as mounted, in the same frame.
        any_rotation: Whether it is mounted however it is turned.
    """

    first: int = Field(ge=0, lt=MOST_PARTS)
    second: int = Field(ge=0, lt=MOST_PARTS)
    target: Target
    also_at: tuple[Target, ...] = Field(default=(), max_length=MOST_TARGETS)
    any_rotation: bool = False


class FeatureSpec(StrictConfig):
    """The numbers of an assembly task that the features need.

    Attributes:
        num_parts: Parts in the observation.
        pairs: What is to be joined, in order.
        mounted_m: How close each coordinate of a part must be to its place for it to be mounted.
        mounted_cosine: Least cosine of the angle between each of its axes and where that belongs.
    """

    num_parts: int = Field(gt=0, le=MOST_PARTS)
    pairs: tuple[PairSpec, ...] = Field(min_length=1, max_length=MOST_PAIRS)
    mounted_m: float = Field(gt=0, le=10)
    mounted_cosine: float = Field(ge=-1, le=1)

    @model_validator(mode="after")
    def _pairs_name_parts(self) -> Self:
        for pair in self.pairs:
            if max(pair.first, pair.second) >= self.num_parts:
                raise ValueError(f"pair ({pair.first}, {pair.second}) names a part beyond num_parts={self.num_parts}")
        return self


class HorizonConfig(StrictConfig):
    """How many steps a policy sees, predicts and executes; defaults of the paper (Table II)."""

    obs: int = Field(default=1, gt=0, le=64, description="T_o, observations shown to the policy")
    pred: int = Field(default=32, gt=0, le=MOST_HORIZON, description="T_p, actions predicted per call")
    action: int = Field(default=8, gt=0, le=MOST_HORIZON, description="T_a, actions executed per call")

    @model_validator(mode="after")
    def _chunk_covers_execution(self) -> Self:
        if self.obs - 1 + self.action > self.pred:
            raise ValueError(f"obs - 1 + action must not exceed pred, got {self.obs} - 1 + {self.action} > {self.pred}")
        return self


class UNetConfig(StrictConfig):
    """1-D U-Net over the action chunk; the defaults are the paper's, 69.12 M parameters."""

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


class MLPDenoiserConfig(StrictConfig):
    """Residual network on the flattened action chunk: the quick denoiser for CPUs."""

    kind: Literal["mlp"] = "mlp"
    width: Size = 512
    blocks: int = Field(default=4, gt=0, le=MOST_BLOCKS)
    step_embedding: Size = Field(default=64, multiple_of=2)


class DiffusionConfig(StrictConfig):
    """Denoising diffusion over action chunks (DDPM training, DDIM sampling)."""

    kind: Literal["diffusion"] = "diffusion"
    denoiser: Annotated[UNetConfig | MLPDenoiserConfig, Field(discriminator="kind")] = UNetConfig()
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


class MLPConfig(StrictConfig):
    """Regression baseline; the defaults are the paper's. Unchunked is ``horizons: {pred: 1, action: 1}``."""

    kind: Literal["mlp"] = "mlp"
    width: Size = 1024
    blocks: int = Field(default=5, gt=0, le=MOST_BLOCKS)
    dropout: float = Field(default=0.1, ge=0, lt=1)


class PolicyConfig(StrictConfig):
    """A policy: what it observes, over which horizons, and how it chooses actions."""

    horizons: HorizonConfig = HorizonConfig()
    action_frame: Literal["absolute", "relative"] = Field(
        default="absolute",
        description="actions as targets in the robot base frame, or relative to the current end effector",
    )
    action_limits: Literal["per_dimension", "per_step"] = Field(
        default="per_dimension",
        description="whether all steps of a chunk share their normalisation limits, as in the original, or each step "
        "has its own: relative to the gripper the first steps move little, and a shared scale hides their detail",
    )
    observation: StateObservationConfig = StateObservationConfig()
    task_embedding: Size = Field(
        default=128, description="length of the learned vector that tells a policy for several tasks which it is"
    )
    head: Annotated[DiffusionConfig | MLPConfig, Field(discriminator="kind")] = DiffusionConfig()

    @model_validator(mode="after")
    def _unet_can_halve_the_chunk(self) -> Self:
        unet = self.head.kind == "diffusion" and self.head.denoiser.kind == "unet"
        if unet and self.horizons.pred % UNET_LENGTH_MULTIPLE:
            raise ValueError(
                f"a U-Net needs horizons.pred to be a multiple of {UNET_LENGTH_MULTIPLE}, got {self.horizons.pred}"
            )
        return self

    @model_validator(mode="after")
    def _can_be_held_in_memory(self) -> Self:
        if (size := rough_parameters(self)) > MOST_PARAMETERS:
            raise ValueError(f"a policy of about {size:,} weights is too large; at most {MOST_PARAMETERS:,} are taken")
        return self


def rough_parameters(policy: PolicyConfig) -> int:
    """Learned weights of a policy, to within a few per cent for the sizes that matter."""
    chunk, shown = policy.horizons.pred * ACTION_SIZE, policy.horizons.obs * _TYPICAL_FEATURES
    if isinstance(policy.head, MLPConfig):
        return _rough_mlp(policy.head.width, policy.head.blocks, shown + chunk)
    denoiser = policy.head.denoiser
    if isinstance(denoiser, MLPDenoiserConfig):
        return _rough_mlp(denoiser.width, denoiser.blocks, shown + 2 * chunk + denoiser.step_embedding)
    low, middle, high = denoiser.channels
    convolutions = 7 * low**2 + 6 * middle**2 + 7 * high**2 + 3 * low * middle + 3 * middle * high
    modulation = 8 * (low + middle + high) * (shown + denoiser.step_embedding)
    return denoiser.kernel_size * convolutions + modulation + 7 * (low**2 + middle**2)


def _rough_mlp(width: int, blocks: int, ends: int) -> int:
    return width * (2 * blocks * width + ends)
