"""Operator logs: what a recording tool writes while somebody teleoperates the robot.

One compressed ``.npz`` file a demonstration: the JSON entry ``header``, and arrays. Every control step is in it, idle
ones too, so that a gap in the timestamps means lost steps. Nothing in a log is pickled.
"""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from juicer.episode import FINAL_KEYS, STEP_DTYPES
from juicer.errors import RejectedLog

FORMAT = "juicer-operator-log"
VERSION = 1
SUFFIX = ".npz"

_ARRAYS: Mapping[str, type[np.generic]] = {**STEP_DTYPES, "timestamp_s": np.float64, "idle": np.bool_}
_HEADER_TYPES: Mapping[str, type | tuple[type, ...]] = {
    "task": str,
    "randomness": str,
    "seed": int,
    "device": str,
    "success": bool,
    "outcome": (str, type(None)),
    "parts_assembled": int,
    "milestones": dict,
}


@dataclass(frozen=True)
class OperatorLog:
    """One recording, from a reset to the moment the operator ended it.

    Attributes:
        task: Assembly task, e.g. ``one_leg``.
        randomness: Level of the initial state.
        seed: Initial-state seed that ``reset`` was given.
        device: What the operator held.
        success: The operator's mark: keep this demonstration.
        outcome: How the environment ended it; None if the operator stopped before.
        parts_assembled: Number of pairs assembled at its end.
        steps: Arrays of :data:`juicer.episode.STEP_DTYPES`, each ``(T, ...)``.
        final: Observation and simulator state after the last action.
        timestamp_s: Seconds since the recording began at which each action was sent ``(T,)``.
        idle: Whether the operator commanded nothing, so that the robot held its last target ``(T,)``.
        milestones: First step at which each milestone was reached, by name.
    """

    task: str
    randomness: str
    seed: int
    device: str
    success: bool
    outcome: str | None
    parts_assembled: int
    steps: Mapping[str, NDArray[np.generic]]
    final: Mapping[str, NDArray[np.generic]]
    timestamp_s: NDArray[np.float64]
    idle: NDArray[np.bool_]
    milestones: Mapping[str, int] = field(default_factory=dict)

    def __len__(self) -> int:
        """Number of recorded steps, idle ones included."""
        return len(self.steps["action"])


def write_log(path: Path, log: OperatorLog) -> None:
    """Write a log under its final name only once it is whole; equal logs give equal bytes."""
    header = {name: getattr(log, name) for name in _HEADER_TYPES} | {"milestones": dict(log.milestones)}
    text = json.dumps({"format": FORMAT, "version": VERSION, **header}, sort_keys=True)
    per_step = {**log.steps, "timestamp_s": log.timestamp_s, "idle": log.idle}
    arrays: dict[str, NDArray[Any]] = {name: np.asarray(per_step[name], dtype) for name, dtype in _ARRAYS.items()}
    arrays |= {f"final_{name}": np.asarray(log.final[name], STEP_DTYPES[name]) for name in FINAL_KEYS}
    draft = path.with_name(f".{path.name}.draft")
    try:
        with draft.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, header=np.array(text), **arrays)
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)


def read_log(path: Path) -> OperatorLog:
    """Read a log back.

    Only the file is judged here, whether it holds a good demonstration is :mod:`juicer.ingestion`'s question.

    Raises:
        RejectedLog: If the file is missing, truncated, of another format or version, or lacks an entry, or if an
            entry is of another type than it must be.
    """
    try:
        # A context for the file, not only for the archive: numpy leaves it open when the archive is broken.
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            header = _header(archive)
            arrays = {name: _array(archive, name, dtype) for name, dtype in _ARRAYS.items()}
            final = {name: _array(archive, f"final_{name}", STEP_DTYPES[name]) for name in FINAL_KEYS}
    except FileNotFoundError:
        raise RejectedLog("the file does not exist") from None
    except RejectedLog:
        raise
    except KeyError as error:
        raise RejectedLog(f"entry {error.args[0].split(' ')[0]!r} is missing; record it again") from None
    except (OSError, EOFError, ValueError, AttributeError, TypeError, zipfile.BadZipFile, zlib.error) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise RejectedLog(f"the file is truncated or no operator log ({reason})") from None
    return OperatorLog(
        **{name: header[name] for name in _HEADER_TYPES},
        steps={name: arrays[name] for name in STEP_DTYPES},
        final=final,
        timestamp_s=arrays["timestamp_s"],
        idle=arrays["idle"],
    )


def _header(archive: Mapping[str, Any]) -> dict[str, Any]:
    header = json.loads(str(archive["header"]))
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        raise RejectedLog(f"the header does not say format '{FORMAT}'")
    if header.get("version") != VERSION:
        raise RejectedLog(f"it has format version {header.get('version')}, but this program reads version {VERSION}")
    for name, kind in _HEADER_TYPES.items():
        value = header.get(name, _MISSING)
        # To Python true and false are integers.
        if not isinstance(value, kind) or (kind is int and isinstance(value, bool)):
            raise RejectedLog(f"header entry '{name}' is missing or of the wrong type")
    for name, step in header["milestones"].items():
        if not isinstance(step, int) or isinstance(step, bool) or step < 0:
            raise RejectedLog(f"milestone '{name}' must be the number of a step, got {step!r}")
    return header


def _array(archive: Mapping[str, Any], name: str, dtype: type[np.generic]) -> NDArray[Any]:
    """An array as it is stored, so that nothing that is judged now changes when it is written."""
    values: NDArray[Any] = archive[name]
    if values.ndim == 0 or not np.can_cast(values.dtype, dtype, "same_kind"):
        raise RejectedLog(
            f"array '{name}' must hold {np.dtype(dtype)} along an axis, got {values.dtype} of shape {values.shape}"
        )
    with np.errstate(over="ignore"):  # what is too large becomes infinite, and is named as such
        return values.astype(dtype)


_MISSING = object()
