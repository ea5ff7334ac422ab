"""What a policy is made of, as configuration; free of torch, so that commands which only read it start fast."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Literal, Self

from pydantic import Field, field_validator, model_validator

from juicer.config import StrictConfig, canonical_json, parse_config
from juicer.episode import ACTION_SIZE
from juicer.errors import ConfigError
from juicer.policy.encoders.features.config import FeaturesConfig
from juicer.policy.heads.diffusion.config import DiffusionConfig
from juicer.policy.members import ENCODERS, HEADS, EncoderConfig, HeadConfig, Size
from juicer.views import View

MOST_PARAMETERS = 500_000_000
"""Learned weights of the largest policy: 2 GB in fp32, seven times the paper's."""

MOST_PARTS, MOST_PAIRS, MOST_TARGETS, MOST_TASKS = 64, 32, 16, 16
MOST_ENCODERS = 16
MOST_HORIZON = 1024

if TYPE_CHECKING:
    AnyEncoder = EncoderConfig
    AnyHead = HeadConfig
else:
    AnyEncoder = Annotated[ENCODERS.choice(), ENCODERS]
    AnyHead = Annotated[HEADS.choice(), HEADS]

TASK_KEY = "task"
"""Observation ``(1,)`` of policies for several tasks: the number of the task."""

EncoderName = Annotated[str, Field(pattern=r"^[a-z]\w*$", max_length=100)]

Coordinate = Annotated[float, Field(ge=-10, le=10)]
Target = tuple[Coordinate, Coordinate, Coordinate, Coordinate, Coordinate, Coordinate, Coordinate]


class SymmetrySpec(StrictConfig):
    """After which turn about its own y axis a part looks the same, to the fingers at least.

    Attributes:
        every_rad: The turn.
        straight: Its rotation when it is not turned, a quaternion wxyz: of a task's first part in the robot base frame,
            of a part that is mounted as seen from the end effector that screws it.
    """

    every_rad: float = Field(gt=0, le=2 * math.pi)
    straight: tuple[Coordinate, Coordinate, Coordinate, Coordinate]


class PairSpec(StrictConfig):
    """Two parts that are to be joined, the second inserted along its own y axis and screwed about it.

    Attributes:
        first: Index of the part that receives.
        second: Index of the part that is moved.
        target: Assembled pose ``(7,)`` of the second part in the frame of the first: metres, quaternion wxyz.
        also_at: Other poses at which it counts as mounted, in the same frame.
        any_rotation: Whether it is mounted however it is turned.
        symmetry: Of the second part, if it has one.
    """

    first: int = Field(ge=0, lt=MOST_PARTS)
    second: int = Field(ge=0, lt=MOST_PARTS)
    target: Target
    also_at: tuple[Target, ...] = Field(default=(), max_length=MOST_TARGETS)
    any_rotation: bool = False
    symmetry: SymmetrySpec | None = None


class FeatureSpec(StrictConfig):
    """The numbers of an assembly task that the features need.

    Attributes:
        num_parts: Parts in the observation.
        pairs: What is to be joined, in order.
        mounted_m: How close each coordinate of a part must be to its place for it to be mounted.
        mounted_cosine: Least cosine of the angle between each of its axes and where that belongs.
        symmetry: Of the first part and the places on it, if they have one.
    """

    num_parts: int = Field(gt=0, le=MOST_PARTS)
    pairs: tuple[PairSpec, ...] = Field(min_length=1, max_length=MOST_PAIRS)
    mounted_m: float = Field(gt=0, le=10)
    mounted_cosine: float = Field(ge=-1, le=1)
    symmetry: SymmetrySpec | None = None

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
    observation: dict[EncoderName, AnyEncoder] = Field(
        default={"state": FeaturesConfig()},
        min_length=1,
        max_length=MOST_ENCODERS,
        description="encoders of what is seen, by names of one's choice; the network is shown what all of them yield",
    )
    task_embedding: Size = Field(
        default=128, description="length of the learned vector that tells a policy for several tasks which it is"
    )
    head: AnyHead = DiffusionConfig()

    @property
    def views_seen(self) -> tuple[View, ...]:
        """Views that it looks at when it acts, each once."""
        return tuple({view.name: view for each in self.observation.values() for view in each.views_seen}.values())

    @property
    def learned_views(self) -> tuple[View, ...]:
        """Views whose images it is trained on, each once."""
        return tuple({view.name: view for each in self.observation.values() for view in each.learned_views}.values())

    @property
    def fixed_parts(self) -> tuple[EncoderConfig, ...]:
        """Encoders whose results it is trained on, each once."""
        parts = [part for each in self.observation.values() for part in each.fixed_parts]
        return tuple({canonical_json(part): part for part in parts}.values())

    @property
    def draws_samples(self) -> bool:
        """Whether what it predicts depends on noise, so that there are several chunks to choose among."""
        return "inference_steps" in type(self.head).model_fields

    @field_validator("observation", mode="before")
    @classmethod
    def _names_its_encoders(cls, given: object) -> object:
        if isinstance(given, Mapping) and given and FeaturesConfig.model_fields.keys() >= given.keys():
            raise ValueError(
                "names one encoder or several, e.g. {state: {kind: features, pairs: all}}; until now it held the "
                "settings of the only one"
            )
        if isinstance(given, Mapping) and TASK_KEY in given:
            raise ValueError(f"an encoder may not be called '{TASK_KEY}': so is called what tells the task")
        return given

    @model_validator(mode="after")
    def _head_can_predict_so_far(self) -> Self:
        self.head.check_horizon(self.horizons.pred)
        return self

    @model_validator(mode="after")
    def _can_be_held_in_memory(self) -> Self:
        if (size := rough_parameters(self)) > MOST_PARAMETERS:
            raise ValueError(f"a policy of about {size:,} weights is too large; at most {MOST_PARAMETERS:,} are taken")
        return self


def rough_parameters(policy: PolicyConfig) -> int:
    """Learned weights of a policy, to within a few per cent for the sizes that matter."""
    encoders = policy.observation.values()
    shown = policy.horizons.obs * sum(encoder.rough_features() for encoder in encoders)
    head = policy.head.rough_parameters(policy.horizons.pred * ACTION_SIZE, shown)
    return head + sum(encoder.rough_parameters() for encoder in encoders)


def sampled_in(policy: PolicyConfig, inference_steps: int) -> PolicyConfig:
    """The same policy with a head that samples a chunk in another number of steps.

    Raises:
        ConfigError: If its head has no such setting, or cannot sample in so many.
    """
    head = policy.head
    if not policy.draws_samples:
        raise ConfigError(f"a head of kind '{head.kind}' has no inference_steps to choose")
    changed = {**head.model_dump(), "inference_steps": inference_steps}
    return policy.model_copy(update={"head": parse_config(changed, type(head), origin=f"head '{head.kind}'")})
