"""Operator logs: what a recording tool writes while somebody teleoperates the robot.

One compressed ``.npz`` file a demonstration: the JSON entry ``header``, and arrays. Every control step is in it, idle
ones too, so that a gap in the timestamps means lost steps. Nothing in a log is pickled.
"""

from __future__ import annotations

import errno
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from juicer.demonstration.archive import MOST_FILE_BYTES, Archive, ArrayHeader, explained
from juicer.demonstration.header import FORMAT, MOST_HEADER_LETTERS, VERSION, LogHeader, parse_header
from juicer.episode import ACTION_SIZE, SIMULATOR, ArraySpec, Episode, Outcome, Role
from juicer.errors import LogNotWritten, RejectedLog
from juicer.reading import read_bounded
from juicer.text import printable

__all__ = [
    "FINAL_PREFIX",
    "FORMAT",
    "LOG",
    "MOST_STEPS",
    "PARENT_ACTION",
    "SUFFIX",
    "VERSION",
    "LogFile",
    "OperatorLog",
    "read_log",
    "write_log",
]

SUFFIX = ".npz"

MOST_STEPS = 20_000
"""Longest log, idle steps included: more than half an hour."""

_HEADER = "header"
FINAL_PREFIX = "final_"
"""What the names of the arrays after the last step begin with."""

PARENT_ACTION = "parent_action"
"""Name of the array that only corrections have."""

LOG = SIMULATOR.extended(
    ArraySpec("timestamp_s", (), "float64", Role.DERIVED), ArraySpec("idle", (), "bool", Role.DERIVED)
)
"""Arrays that have an entry a step."""

_ARRAYS: Mapping[str, np.dtype[Any]] = {
    **{spec.name: np.dtype(spec.dtype) for spec in LOG},
    **{f"{FINAL_PREFIX}{name}": np.dtype(LOG[name].dtype) for name in LOG.ends},
}


@dataclass(frozen=True, kw_only=True)
class OperatorLog(LogHeader):
    """One recording, from a reset to the moment the operator ended it.

    Attributes:
        steps: Arrays of :data:`juicer.episode.SIMULATOR`, each ``(T, ...)``.
        final: Observation and simulator state after the last action.
        timestamp_s: Seconds since the recording began at which each action was sent ``(T,)``.
        idle: Whether the operator commanded nothing, so that the robot held its last target ``(T,)``.
        parent_actions: Of a correction, the actions that lead from the reset to its beginning ``(parent_step, 10)``;
            of a demonstration, none.
    """

    steps: Mapping[str, NDArray[np.generic]]
    final: Mapping[str, NDArray[np.generic]]
    timestamp_s: NDArray[np.float64]
    idle: NDArray[np.bool_]
    parent_actions: NDArray[np.float32] = field(default_factory=lambda: np.empty((0, ACTION_SIZE), np.float32))

    @classmethod
    def of(
        cls,
        episode: Episode,
        timestamp_s: NDArray[np.float64],
        idle: NDArray[np.bool_],
        parent_actions: NDArray[np.float32] | None = None,
        *,
        success: bool | None = None,
    ) -> Self:
        """Log of an episode that was recorded just now.

        Args:
            episode: What was recorded; its record says by whom, with which device.
            timestamp_s: When each action was sent ``(T,)``.
            idle: Whether the operator commanded nothing ``(T,)``.
            parent_actions: Of a correction, the actions that lead from the reset to its beginning.
            success: The operator's mark; what the environment says if None.
        """
        record = episode.record
        facts: dict[str, Any] = {
            entry.name: getattr(record, entry.name) for entry in fields(LogHeader) if entry.name != "success"
        }
        kept = record.outcome is Outcome.SUCCESS if success is None else success
        led: dict[str, Any] = {} if parent_actions is None else {"parent_actions": parent_actions}
        return cls(
            **facts, **led, success=kept, steps=episode.steps, final=episode.final, timestamp_s=timestamp_s, idle=idle
        )

    def __len__(self) -> int:
        """Number of recorded steps, idle ones included."""
        return len(self.steps["action"])

    @property
    def arrays(self) -> Mapping[str, NDArray[np.generic]]:
        """All arrays by the names they have in the file."""
        final = {f"{FINAL_PREFIX}{name}": values for name, values in self.final.items()}
        led = {} if self.parent is None else {PARENT_ACTION: self.parent_actions}
        return {**self.steps, "timestamp_s": self.timestamp_s, "idle": self.idle, **final, **led}


class LogFile:
    """A log on the disk, of which only the header and the shapes have been looked at so far.

    Attributes:
        header: What it says about itself.
        shapes: Shape of every array, by name; those after the last step begin with ``final_``.
    """

    def __init__(self, path: Path) -> None:
        """Look at a file.

        Raises:
            RejectedLog: If it cannot be read, is no operator log, of another version, lacks an array, or says that it
                is larger than a log is. Nothing but the header has been unpacked then.
        """
        self._archive = Archive(_content(path), [_HEADER, *_ARRAYS], [PARENT_ACTION])
        specs = self._archive.specs
        self.header = parse_header(self._header_text())
        self._arrays = _arrays_of(self.header)
        if PARENT_ACTION in self._arrays and PARENT_ACTION not in specs:
            raise RejectedLog(
                "it is a correction of an earlier version of juicer, without the actions of its rollout that prove "
                "where it begins; finish the rollout by hand again"
            )
        for name, dtype in self._arrays.items():
            _check_header(name, specs[name], dtype)
        self.shapes: Mapping[str, tuple[int, ...]] = {name: specs[name].shape for name in self._arrays}
        if self.num_steps > MOST_STEPS:
            raise RejectedLog(f"it holds {self.num_steps:,} steps; a log has at most {MOST_STEPS:,}")

    @property
    def num_steps(self) -> int:
        """Number of recorded steps, idle ones included."""
        return self.shapes["action"][0]

    def read(self) -> OperatorLog:
        """Unpack the arrays.

        Raises:
            RejectedLog: If one cannot be unpacked.
        """
        with explained():
            arrays = {name: self._read(name, dtype) for name, dtype in self._arrays.items()}
        led: dict[str, Any] = {"parent_actions": arrays[PARENT_ACTION]} if PARENT_ACTION in arrays else {}
        return OperatorLog(
            **{entry.name: getattr(self.header, entry.name) for entry in fields(LogHeader)},
            steps={name: arrays[name] for name in SIMULATOR.names()},
            final={name: arrays[f"{FINAL_PREFIX}{name}"] for name in LOG.ends},
            timestamp_s=arrays["timestamp_s"],
            idle=arrays["idle"],
            **led,
        )

    def _header_text(self) -> str:
        spec = self._archive.specs[_HEADER]
        if spec.shape or spec.dtype.kind != "U":
            raise RejectedLog("the header is not one text")
        if spec.num_bytes > 4 * MOST_HEADER_LETTERS:
            raise RejectedLog(f"the header has {spec.num_bytes // 4:,} letters; it may have {MOST_HEADER_LETTERS:,}")
        with explained():
            return str(self._archive.read(_HEADER))

    def _read(self, name: str, dtype: np.dtype[Any]) -> NDArray[Any]:
        """An array as it is stored, so that nothing that is judged now changes when it is written."""
        with np.errstate(over="ignore", invalid="ignore"):  # what is too large becomes infinite, and is named as such
            return np.ascontiguousarray(self._archive.read(name).astype(dtype, copy=False))


def read_log(path: Path) -> OperatorLog:
    """Read a log back.

    Only the file is judged here; :mod:`juicer.demonstration.ingestion` judges whether it holds a good demonstration.

    Raises:
        RejectedLog: If the file is missing, truncated, of another format or version, larger than a log is, or lacks an
            entry, or if an entry is of another type than it must be.
    """
    return LogFile(path).read()


def write_log(path: Path, log: OperatorLog) -> None:
    """Write a log under its final name only once it is whole; equal logs give equal bytes.

    Raises:
        RejectedLog: If the log lacks an array, or an array or an entry of its header is of another type, shape or
            length than it must be; nothing is written then.
        LogNotWritten: If the name does not end in ``.npz``, there is no such folder, or the disk refuses the write.
    """
    if path.suffix != SUFFIX:
        raise LogNotWritten(errno.EINVAL, f"its name must end in {SUFFIX}", str(path))
    if not path.parent.is_dir():
        raise LogNotWritten(errno.ENOENT, "its folder does not exist; make it first", str(path))
    text = log.to_text()
    arrays = _arrays(log)
    draft = path.with_name(f".{path.name}.draft")
    try:
        with draft.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, **{_HEADER: np.array(text)}, **arrays)
        draft.replace(path)
    except OSError as error:
        raise LogNotWritten(error.errno, error.strerror, str(path)) from None
    finally:
        draft.unlink(missing_ok=True)


def _content(path: Path) -> bytes:
    try:
        return read_bounded(path, MOST_FILE_BYTES)
    except FileNotFoundError:
        reason = "it is a link to a file that does not exist" if path.is_symlink() else "the file does not exist"
        raise RejectedLog(reason) from None
    except OSError as error:
        raise RejectedLog(f"the file cannot be read: {error.strerror or type(error).__name__}") from None
    except MemoryError:
        raise RejectedLog("the file cannot be read: memory does not suffice") from None


def _arrays(log: OperatorLog) -> dict[str, NDArray[Any]]:
    """The arrays of a log as they are stored."""
    given = log.arrays
    demanded = _arrays_of(log)
    if unknown := sorted(set(given) - set(demanded)):
        raise RejectedLog(f"there is no place in a log for the array '{printable(unknown[0])}'")
    arrays = {}
    for name, dtype in demanded.items():
        if name not in given:
            raise RejectedLog(f"array '{name}' is missing")
        try:
            values = np.asarray(given[name])
        except ValueError:
            raise RejectedLog(f"array '{name}' is made of rows of different lengths") from None
        _check_header(name, ArrayHeader(values.dtype, values.shape), dtype)
        arrays[name] = values.astype(dtype, copy=False)
    _check_shapes({name: values.shape for name, values in arrays.items()})
    check_parent_actions(log, log.parent_actions.shape)
    return arrays


def _arrays_of(header: LogHeader) -> Mapping[str, np.dtype[Any]]:
    """Types of the arrays that a log must have, by name."""
    return _ARRAYS if header.parent is None else {**_ARRAYS, PARENT_ACTION: np.dtype(np.float32)}


def check_parent_actions(header: LogHeader, shape: tuple[int, ...]) -> None:
    """Refuse another number of actions before a log's beginning than its header says.

    Raises:
        RejectedLog: If there is one.
    """
    if shape != (header.first_step, ACTION_SIZE):
        raise RejectedLog(
            f"array '{PARENT_ACTION}' must have the shape {(header.first_step, ACTION_SIZE)}, got {printable(shape)}"
        )
    if header.first_step > MOST_STEPS:
        raise RejectedLog(
            f"it begins after {header.first_step:,} steps of its rollout; it may do so after {MOST_STEPS:,}"
        )


def _check_header(name: str, spec: ArrayHeader, dtype: np.dtype[Any]) -> None:
    if not spec.shape or not np.can_cast(spec.dtype, dtype, "same_kind"):
        raise RejectedLog(
            f"array '{name}' must hold {dtype} along an axis, got {printable(spec.dtype)} "
            f"of shape {printable(spec.shape)}"
        )


def _check_shapes(shapes: Mapping[str, tuple[int, ...]]) -> None:
    length = shapes["action"][0]
    if not 0 < length <= MOST_STEPS:
        raise RejectedLog(f"a log must hold 1 to {MOST_STEPS:,} steps, got {length:,}")
    for spec in LOG:
        shape = shapes[spec.name]
        expected = (length, *(shape[-1] if size is None else size for size in spec.shape))
        if shape != expected:
            raise RejectedLog(f"array '{spec.name}' must have the shape {expected}, got {printable(shape)}")
    for name in LOG.ends:
        shape = shapes[FINAL_PREFIX + name]
        if shape != shapes[name][1:]:
            raise RejectedLog(f"array '{FINAL_PREFIX}{name}' must have the shape {shapes[name][1:]}, got {shape}")
