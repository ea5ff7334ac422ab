"""The episode: aligned steps from one reset to its end, whatever its source.

The observation and the simulator state of index ``t`` were taken *before* the action of index ``t``.
The last observation, which no action follows, is kept apart in ``final``.

What arrays an episode has is said by its :class:`Schema`. Those of our own simulator have :data:`SIMULATOR`; data from
elsewhere may have other observations, and no simulator state.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from juicer.errors import InvalidEpisode, StateMissing

PROPRIOCEPTION_SIZE = 16
"""End-effector position (3, m, robot base frame), rotation 6D (6), linear velocity (3, m/s),
angular velocity (3, rad/s), gripper width (1, m)."""

ACTION_SIZE = 10
"""Absolute end-effector target position (3, m, robot base frame), rotation 6D (6), gripper (+1 close, -1 open)."""

STATE_KEY = "sim_state"
RECORDED_STEP_KEY = "recorded_step"
CONTINUOUS_KEY = "continuous"

ID_DIGITS = 16
"""Hexadecimal digits of an episode's id."""

SHORTEST_PREFIX = 6
"""As many of them may stand for it."""

_NAME = re.compile(r"[a-z][a-z0-9_]{0,63}")


class Role(StrEnum):
    """What an array of an episode is for."""

    OBSERVATION = "observation"
    """What a policy may see before it acts."""
    STATE = "state"
    """What restores the simulator exactly."""
    ACTION = "action"
    REWARD = "reward"
    DERIVED = "derived"
    """What was computed from the others."""


@dataclass(frozen=True)
class ArraySpec:
    """One array of an episode.

    Attributes:
        name: Lower-case letters, digits and underscores.
        shape: Shape of one step's entry; None stands for a size that depends on the assembly task.
        dtype: Type of its numbers, e.g. ``float32``.
        role: What it is for.

    Raises:
        ValueError: If the name, a size or the type is none that an array may have.
    """

    name: str
    shape: tuple[int | None, ...]
    dtype: str
    role: Role

    def __post_init__(self) -> None:
        """Check what may come from a file."""
        if not _NAME.fullmatch(self.name):
            raise ValueError(f"{self.name!r} cannot be the name of an array")
        if not all(size is None or size > 0 for size in self.shape):
            raise ValueError(f"array '{self.name}' cannot have the shape {self.shape}")
        try:
            is_plain = np.dtype(self.dtype).kind in "biuf"
        except TypeError:
            is_plain = False
        if not is_plain:
            raise ValueError(f"array '{self.name}' cannot hold {self.dtype!r}")

    @property
    def has_end(self) -> bool:
        """Whether it has an entry after the last action, too."""
        return self.role in (Role.OBSERVATION, Role.STATE)

    def fits(self, shape: tuple[int, ...], dtype: np.dtype[Any]) -> bool:
        """Whether a step's entry of this shape and type is one of this array."""
        sizes = len(shape) == len(self.shape) and all(
            size in (None, given) and given > 0 for size, given in zip(self.shape, shape, strict=True)
        )
        return sizes and dtype == np.dtype(self.dtype)


@dataclass(frozen=True)
class Schema:
    """Which arrays an episode has, in order.

    Raises:
        ValueError: If two have one name.
    """

    specs: tuple[ArraySpec, ...]

    def __post_init__(self) -> None:
        """Check the names."""
        if len({spec.name for spec in self.specs}) < len(self.specs):
            raise ValueError("two arrays of an episode have one name")

    def __iter__(self) -> Iterator[ArraySpec]:
        """The arrays' specifications, in order."""
        return iter(self.specs)

    def __contains__(self, name: object) -> bool:
        """Whether there is an array of this name."""
        return any(spec.name == name for spec in self.specs)

    def __getitem__(self, name: str) -> ArraySpec:
        """Specification of the array of a name.

        Raises:
            KeyError: If there is none.
        """
        for spec in self.specs:
            if spec.name == name:
                return spec
        raise KeyError(name)

    def names(self, *roles: Role) -> tuple[str, ...]:
        """Names of the arrays of these roles, or of all."""
        return tuple(spec.name for spec in self.specs if not roles or spec.role in roles)

    @property
    def ends(self) -> tuple[str, ...]:
        """Names of the arrays that have an entry after the last action, too."""
        return tuple(spec.name for spec in self.specs if spec.has_end)

    def extended(self, *specs: ArraySpec) -> Self:
        """This schema with more arrays."""
        return replace(self, specs=(*self.specs, *specs))

    def sized(self, steps: Mapping[str, NDArray[np.generic]]) -> Self:
        """This schema with the sizes that an episode's arrays really have."""
        return replace(self, specs=tuple(replace(spec, shape=steps[spec.name].shape[1:]) for spec in self.specs))

    def to_json(self) -> list[dict[str, Any]]:
        """As JSON values."""
        return [{"name": s.name, "shape": list(s.shape), "dtype": s.dtype, "role": s.role.value} for s in self.specs]

    @classmethod
    def from_json(cls, content: Any) -> Self:
        """Read it back.

        Raises:
            ValueError: If the content is none that :meth:`to_json` makes.
        """
        try:
            return cls(tuple(ArraySpec(c["name"], tuple(c["shape"]), c["dtype"], Role(c["role"])) for c in content))
        except (TypeError, KeyError) as error:
            raise ValueError(f"its arrays are not described: {error}") from None


SIMULATOR = Schema(
    (
        ArraySpec("proprioception", (PROPRIOCEPTION_SIZE,), "float32", Role.OBSERVATION),
        # Seven a part: position (m, robot base frame) and quaternion wxyz.
        ArraySpec("part_poses", (None,), "float32", Role.OBSERVATION),
        ArraySpec(STATE_KEY, (None,), "float64", Role.STATE),
        ArraySpec("action", (ACTION_SIZE,), "float32", Role.ACTION),
        ArraySpec("reward", (), "float32", Role.REWARD),
    )
)
"""Arrays of the episodes that are recorded in our simulator."""

DEMONSTRATION = SIMULATOR.extended(
    ArraySpec(RECORDED_STEP_KEY, (), "int32", Role.DERIVED), ArraySpec(CONTINUOUS_KEY, (), "bool", Role.DERIVED)
)
"""The same for demonstrations, of which idle steps were dropped: the number that each step has in the recording; and
whether its action leads from its own simulator state to that of the next step, which it does not where steps were
dropped in between."""


class Source(StrEnum):
    """Where an episode comes from."""

    TELEOP = "teleop"
    AUGMENTATION = "augmentation"
    ROLLOUT = "rollout"
    CORRECTION = "correction"
    """An operator has taken over from a policy, and finished what it could not."""


class Outcome(StrEnum):
    """How an episode ended."""

    SUCCESS = "success"
    TIMEOUT = "timeout"
    PART_LOST = "part_lost"
    DIVERGED = "diverged"


@dataclass(frozen=True)
class EpisodeRecord:
    """Facts about one episode: a row of ``episodes.parquet``.

    Attributes:
        source: Where the episode comes from.
        task: Assembly task, e.g. ``one_leg``.
        randomness: Level of the initial state: ``low``, ``med`` or ``high``.
        seed: Initial-state seed that ``reset`` was given.
        outcome: How it ended.
        parts_assembled: Number of pairs assembled at its end.
        milestones: First step at which each milestone was reached, by name; absent if never reached.
        policy: Id of the checkpoint that acted, for rollouts.
        parent: Id of the episode it was grown from, for augmentation and corrections.
        parent_step: Step of that episode at which an operator took over, for corrections.
        critical_state: Index of the critical state it returns to, for augmentation.
        device: What the operator held, for teleoperation and corrections.
        operator: Who the operator was, as far as the log says.
        recorded_at: When, as the log says it.
        log: Name of the operator log it was ingested from.
        shift: The shift it was made under, as JSON, see :mod:`juicer.shifts`; such an episode is for evaluation only.
        episode_id: Digest of the recording, 16 hexadecimal digits: the same wherever the episode is kept. Of a
            demonstration, it is that of the log, idle steps included. Given by :class:`Episode` if it is empty.
    """

    source: Source
    task: str
    randomness: str
    seed: int
    outcome: Outcome
    parts_assembled: int = 0
    milestones: Mapping[str, int] = field(default_factory=dict)
    policy: str | None = None
    parent: str | None = None
    parent_step: int | None = None
    critical_state: int | None = None
    device: str | None = None
    operator: str | None = None
    recorded_at: str | None = None
    log: str | None = None
    shift: str | None = None
    episode_id: str = ""


@dataclass(frozen=True)
class Episode:
    """Aligned steps and the facts about them.

    Attributes:
        record: Facts about the episode.
        steps: Arrays of the schema, each ``(T, ...)``.
        final: The observation and simulator state after the last action, each without a time axis.
        schema: What the arrays are.

    Raises:
        InvalidEpisode: If an array is missing, has another shape, type or length, or holds a non-finite value.
    """

    record: EpisodeRecord
    steps: Mapping[str, NDArray[np.generic]]
    final: Mapping[str, NDArray[np.generic]]
    schema: Schema = SIMULATOR

    def __post_init__(self) -> None:
        """Check that every array is there, finite, and of one length."""
        names = self.schema.names()
        if set(self.steps) != set(names):
            raise InvalidEpisode(f"an episode needs the arrays {sorted(names)}, got {sorted(self.steps)}")
        lengths = {name: len(values) for name, values in self.steps.items()}
        if len(set(lengths.values())) != 1 or len(self) == 0:
            raise InvalidEpisode(f"the arrays of an episode need one common, positive length, got {lengths}")
        if set(self.final) != set(self.schema.ends):
            raise InvalidEpisode(f"the final observation needs {sorted(self.schema.ends)}, got {sorted(self.final)}")
        for spec in self.schema:
            self._check(spec)
        if not self.record.episode_id:
            object.__setattr__(self, "record", replace(self.record, episode_id=self._digest()))

    def __len__(self) -> int:
        """Number of actions."""
        return len(next(iter(self.steps.values()), ()))

    def observation(self, step: int) -> dict[str, NDArray[np.generic]]:
        """What was observed before the action of a step; for the step after the last, at the end."""
        return {name: self._at(name, step) for name in self.schema.names(Role.OBSERVATION)}

    def state(self, step: int) -> NDArray[np.float64]:
        """Simulator state before the action of a step; for the step after the last, at the end.

        Raises:
            StateMissing: If the episode has none, or no such step.
        """
        require_state(self.schema, f"episode {self.record.episode_id}")
        if not -len(self) <= step <= len(self):
            raise StateMissing(f"the episode has steps 0 to {len(self) - 1} and the end, {len(self)}, not {step}")
        return np.asarray(self._at(STATE_KEY, step), dtype=np.float64)

    def recorded_step(self, step: int) -> int:
        """Number of a step in the recording, in which idle steps count too; for the step after the last, at the end."""
        if RECORDED_STEP_KEY not in self.schema:
            return step
        numbers = self.steps[RECORDED_STEP_KEY]
        return int(numbers[step]) if step < len(self) else int(numbers[-1]) + 1

    def step_of(self, recorded: int) -> int | None:
        """Step that a step of the recording became; of a dropped one, the step before it; None behind the last."""
        if not 0 <= recorded <= self.recorded_step(len(self) - 1):
            return None
        if RECORDED_STEP_KEY not in self.schema:
            return recorded
        return max(int(np.searchsorted(self.steps[RECORDED_STEP_KEY], recorded, side="right")) - 1, 0)

    def _at(self, name: str, step: int) -> NDArray[np.generic]:
        return self.final[name] if step == len(self) else self.steps[name][step]

    def _check(self, spec: ArraySpec) -> None:
        values = self.steps[spec.name]
        if not spec.fits(values.shape[1:], values.dtype):
            raise InvalidEpisode(
                f"array '{spec.name}' of an episode must hold {spec.dtype} of shape {_shown(spec.shape)} a step, "
                f"got {values.dtype} of shape {values.shape[1:]}"
            )
        # Numbers that are whole are finite.
        if values.dtype.kind == "f" and not np.isfinite(values).all():
            raise InvalidEpisode(f"array '{spec.name}' of an episode holds NaN or infinite values")
        if spec.has_end and (self.final[spec.name].shape, self.final[spec.name].dtype) != (
            values.shape[1:],
            values.dtype,
        ):
            raise InvalidEpisode(f"the final '{spec.name}' of an episode is unlike that of its steps")

    def _digest(self) -> str:
        """Everything else that an episode shows follows from its actions and, if it has them, its states."""
        schema, record = self.schema, self.record
        seen = schema.names(Role.STATE) or schema.names(Role.OBSERVATION)
        content = hashlib.sha256(json.dumps([record.source, record.task, record.seed]).encode())
        for name in (*schema.names(Role.ACTION), *seen):
            values = self.steps[name]
            content.update(f"\n{name} {values.dtype} {values.shape}\n".encode())
            content.update(np.ascontiguousarray(values).data)
        return content.hexdigest()[:ID_DIGITS]


def episodes_named(name: str, records: Sequence[EpisodeRecord]) -> list[int]:
    """Numbers of the episodes that answer to a name: an id, the beginning of one, or the name of a log."""
    is_prefix = len(name) >= SHORTEST_PREFIX
    return [
        number
        for number, record in enumerate(records)
        if record.log == name or (is_prefix and record.episode_id.startswith(name))
    ]


def require_state(schema: Schema, whose: str) -> None:
    """Refuse arrays without a simulator state, before anything is begun that needs one.

    Raises:
        StateMissing: If there is none.
    """
    if STATE_KEY not in schema:
        raise StateMissing(
            f"{whose} holds no simulator state, so none of its steps can be restored: only what was recorded in "
            "juicer's own simulator can be replayed, searched for critical states or augmented"
        )


def _shown(shape: Iterable[int | None]) -> str:
    return f"({', '.join('any' if size is None else str(size) for size in shape)})"


class DemonstrationReader(Protocol):
    """Episodes by number, e.g. :class:`juicer.storage.episodes.EpisodeReader`."""

    def __len__(self) -> int:
        """Number of episodes."""
        ...

    @property
    def records(self) -> Sequence[EpisodeRecord]:
        """Facts about every episode, in order."""
        ...

    def read(self, index: int) -> Episode:
        """The episode of a number."""
        ...
