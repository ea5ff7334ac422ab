"""Critical states of episodes, one row each."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

import pyarrow as pa

from juicer.storage.tables import read_table, write_table

_ANNOTATIONS = pa.schema(
    {
        "episode_id": pa.string(),
        "step": pa.int32(),
        "critical_state": pa.int32(),
        "author": pa.string(),
        "confidence": pa.float64(),
    }
)


@dataclass(frozen=True)
class Annotation:
    """A critical state: id of the episode, step within it, which critical state of the task it is.

    ``confidence`` lies between zero and one; a human's annotation has one.
    """

    episode_id: str
    step: int
    critical_state: int
    author: Literal["proposed", "human"]
    confidence: float


def write_annotations(folder: Path, rows: Iterable[Annotation]) -> None:
    """Write ``annotations.parquet``."""
    write_table(folder / "annotations.parquet", _ANNOTATIONS, map(asdict, rows))


def read_annotations(folder: Path) -> list[Annotation]:
    """Read ``annotations.parquet``."""
    return [Annotation(**row) for row in read_table(folder / "annotations.parquet", _ANNOTATIONS)]
