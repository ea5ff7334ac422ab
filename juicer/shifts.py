"""Shifts: in what a scene differs from all that training has seen. Data only: nothing is simulated or drawn here.

They are for evaluation alone. An episode under a shift says so in its record and in its simulator states.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, ValidationError, model_validator

from juicer.config import StrictConfig, canonical_json
from juicer.episode import EpisodeRecord
from juicer.errors import ConfigError, EvaluationOnly
from juicer.problems import first_problem, show
from juicer.seeding import stream
from juicer.tasks.specification import Randomness
from juicer.yaml_reading import UnreadableYaml, read_yaml

KEYS = 2**32
Share = Annotated[float, Field(ge=0, le=1)]


class _Shift(StrictConfig):
    """What all shifts have in common.

    Attributes:
        phrase: How an evaluation under it was done, as the end of a sentence.
        is_seen_only: Whether it changes nothing but images, so that a policy that sees no images cannot notice it.
    """

    phrase: ClassVar[str]
    is_seen_only: ClassVar[bool] = False

    def can_be_noticed(self, *, sees_images: bool) -> bool:
        """Whether it makes a difference to a policy."""
        return sees_images or not self.is_seen_only

    def check(self, randomness: Randomness) -> None:
        """Refuse a level of randomness from which there is no such shift.

        Raises:
            ValueError: If it is one.
        """


class Outside(_Shift):
    """A part starts where none did in training, drawn from the episode's seed.

    It is one of those that are to be assembled. It is drawn from a wider region, and lies outside the region of the
    evaluation's randomness by its position or by how it is turned. The layouts of ``high`` have no region.
    """

    phrase: ClassVar[str] = "with a part outside the training region"

    kind: Literal["outside"] = "outside"
    wider: float = Field(
        default=2.0, ge=1.1, le=5, description="its shift and turn reach so many times as far as in training"
    )

    def check(self, randomness: Randomness) -> None:
        """See :meth:`_Shift.check`."""
        if randomness is Randomness.HIGH:
            raise ValueError(
                "shift outside: the parts of randomness high lie in a few stored layouts, which have no region to be "
                "outside of; take low or med"
            )


class Push(_Shift):
    """Once in an episode, what the gripper holds is pushed; if it holds nothing, a part that is to be assembled is.

    The push is horizontal. Its moment, its direction and the part are drawn from the episode's seed.
    """

    phrase: ClassVar[str] = "under a push"

    kind: Literal["push"] = "push"
    force_n: float = Field(default=10.0, gt=0, le=100, description="on a part that is held [N]")
    speed_m_s: float = Field(
        default=0.5, gt=0, le=5, description="that a part which is not held would get if nothing rubbed [m/s]"
    )
    steps: int = Field(default=2, gt=0, le=100, description="how long it lasts, in control steps of 0.1 s")
    earliest: Share = Field(default=0.05, description="share of the task's limit of steps from which on it may come")
    latest: Share = Field(default=0.3, description="share of the task's limit of steps up to which it may come")

    @model_validator(mode="after")
    def _comes_in_order(self) -> Self:
        if self.earliest > self.latest:
            raise ValueError(f"earliest must not exceed latest, got {self.earliest} and {self.latest}")
        return self


class Friction(_Shift):
    """Everything rubs more, or less: the fingers on what they hold, the parts on each other and on the table."""

    phrase: ClassVar[str] = "with other friction"

    kind: Literal["friction"] = "friction"
    factor: float = Field(default=0.3, ge=0.05, le=10, description="on every coefficient of friction")


class Light(_Shift):
    """The lamp shines from elsewhere, and all light is brighter or darker; only in what a policy sees.

    In which direction the lamp is moved is drawn from the episode's seed.
    """

    phrase: ClassVar[str] = "under another light"
    is_seen_only: ClassVar[bool] = True

    kind: Literal["light"] = "light"
    turn_rad: float = Field(default=0.6, ge=0, le=1, description="between the lamp's usual direction and this one")
    brightness: float = Field(default=0.7, gt=0, le=3, description="factor on all light")


class Camera(_Shift):
    """Each camera stands and looks a little elsewhere; only in what a policy sees, whose calibration stays the old one.

    The directions are drawn from the episode's seed, for each camera its own.
    """

    phrase: ClassVar[str] = "with moved cameras"
    is_seen_only: ClassVar[bool] = True

    kind: Literal["camera"] = "camera"
    shift_m: float = Field(default=0.01, ge=0, le=0.2, description="how far it is moved")
    turn_rad: float = Field(default=0.02, ge=0, le=0.5, description="how far it is turned, about an axis through it")


Shift = Annotated[Outside | Push | Friction | Light | Camera, Field(discriminator="kind")]
"""Any of them, told apart by its ``kind``."""

_MODELS = (Outside, Push, Friction, Light, Camera)
KINDS = tuple(str(model.model_fields["kind"].default) for model in _MODELS)


class _Holder(StrictConfig):
    shift: Shift


def parse_shift(given: object) -> Shift | None:
    """A shift from what a user says.

    Args:
        given: A shift, its kind and settings as a mapping or as YAML, the name of its kind alone, or None.

    Raises:
        ConfigError: If it is not a shift.
    """
    if given is None or isinstance(given, _MODELS):
        return given
    if isinstance(given, str):
        try:
            given = read_yaml(given).value
        except UnreadableYaml as error:
            raise ConfigError(f"shift {show(given)} cannot be read: {error}") from None
    content: Any = {"shift": {"kind": given} if isinstance(given, str) else given}
    try:
        return _Holder.model_validate(content).shift
    except ValidationError as error:
        raise ConfigError(first_problem(error, content, _Holder).sentence) from None


def require_unshifted(records: Iterable[EpisodeRecord], whose: str) -> None:
    """Refuse episodes under a shift, which nothing may be trained on.

    Raises:
        EvaluationOnly: Naming the first.
    """
    for record in records:
        if record.shift:
            raise EvaluationOnly(
                f"{whose} holds episode {record.episode_id}, which was made under a shift ({record.shift}); such "
                "episodes are for evaluation only, so leave it out"
            )


@dataclass(frozen=True)
class ShiftOfEpisode:
    """What the seed of one episode makes of a shift.

    Attributes:
        shift: The shift.
        key: Root of all that is drawn for the episode, below :data:`KEYS`.
    """

    shift: Shift
    key: int

    @classmethod
    def of(cls, shift: Shift, seed: int) -> Self:
        """For the episode of an initial-state seed."""
        return cls(shift, int(stream(seed, "shift").integers(KEYS)))

    def stream(self, name: str) -> np.random.Generator:
        """Random numbers for a purpose."""
        return stream(self.key, name)

    @property
    def fingerprint(self) -> int:
        """By which the shift is known from others, below :data:`KEYS`."""
        return zlib.crc32(canonical_json(self.shift).encode())
