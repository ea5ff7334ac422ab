"""Numbers behind analyses of a policy, as tables."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from juicer.storage.tables import read_table, write_table

_SAMPLES_FILE, _MONITOR_FILE, _MODES_FILE = "samples.parquet", "monitor.parquet", "modes.parquet"
DIMENSIONS = ("x", "y", "z", "roll", "pitch", "yaw", "gripper")
"""Of a sample: change of position [mm], rotation about the axes of the robot's base [degrees], gripper command."""
_SAMPLES = pa.schema({"inference_steps": pa.int32(), **{name: pa.float64() for name in DIMENSIONS}})
_MONITOR = pa.schema(
    {
        "episode": pa.int32(),
        "seed": pa.int64(),
        "step": pa.int32(),
        "position_mm": pa.float64(),
        "rotation_deg": pa.float64(),
        "gripper": pa.float64(),
        "disagreement_mm": pa.float64(),
        "outcome": pa.string(),
        "length": pa.int32(),
    }
)
_MODES = pa.schema(
    {
        "samples": pa.int32(),
        "episodes": pa.int32(),
        "successes": pa.int32(),
        "interval_low": pa.float64(),
        "interval_high": pa.float64(),
        "p_value": pa.float64(),
        "chunk_ms": pa.float64(),
    }
)


def write_samples(folder: Path, samples: Iterable[tuple[int, NDArray[np.float64]]]) -> None:
    """Write samples ``(n, 7)`` of actions at one state, by the steps in which they were drawn."""
    rows = [
        {"inference_steps": steps, **dict(zip(DIMENSIONS, row, strict=True))}
        for steps, values in samples
        for row in values.tolist()
    ]
    write_table(folder / _SAMPLES_FILE, _SAMPLES, rows)


def read_samples(folder: Path) -> dict[int, NDArray[np.float64]]:
    """Read them back, in order."""
    rows: dict[int, list[list[float]]] = {}
    for row in read_table(folder / _SAMPLES_FILE, _SAMPLES):
        rows.setdefault(row["inference_steps"], []).append([row[name] for name in DIMENSIONS])
    return {steps: np.array(values) for steps, values in rows.items()}


@dataclass(frozen=True)
class MonitorRow:
    """One prediction of a rollout: what was measured there, and how the rollout ended."""

    episode: int
    seed: int
    step: int
    position_mm: float
    rotation_deg: float
    gripper: float
    disagreement_mm: float
    outcome: str
    length: int


def write_monitor(folder: Path, rows: Iterable[MonitorRow]) -> None:
    """Write what was measured along rollouts."""
    write_table(folder / _MONITOR_FILE, _MONITOR, map(asdict, rows))


def read_monitor(folder: Path) -> list[MonitorRow]:
    """Read it back."""
    return [MonitorRow(**row) for row in read_table(folder / _MONITOR_FILE, _MONITOR)]


@dataclass(frozen=True)
class ModesRow:
    """Success and cost of acting on the densest of so many samples; the p-value is against the first row."""

    samples: int
    episodes: int
    successes: int
    interval_low: float
    interval_high: float
    p_value: float
    chunk_ms: float


def write_modes(folder: Path, rows: Iterable[ModesRow]) -> None:
    """Write what numbers of samples come to."""
    write_table(folder / _MODES_FILE, _MODES, map(asdict, rows))


def read_modes(folder: Path) -> list[ModesRow]:
    """Read it back."""
    return [ModesRow(**row) for row in read_table(folder / _MODES_FILE, _MODES)]
