"""Which episodes of an artifact are kept, one row each."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from juicer.storage.episodes import EpisodeReader
from juicer.storage.tables import read_table, write_table

_SELECTION = pa.schema({"episode_id": pa.string(), "keep": pa.bool_(), "reason": pa.string()})


@dataclass(frozen=True)
class SelectionRow:
    """Whether an episode of an artifact is kept, and why."""

    episode_id: str
    keep: bool
    reason: str


def write_selection(folder: Path, rows: Iterable[SelectionRow]) -> None:
    """Write ``selection.parquet``."""
    write_table(folder / "selection.parquet", _SELECTION, map(asdict, rows))


def read_selection(folder: Path) -> list[SelectionRow]:
    """Read ``selection.parquet``."""
    return [SelectionRow(**row) for row in read_table(folder / "selection.parquet", _SELECTION)]


def kept_of(reader: EpisodeReader, folders: Iterable[Path]) -> NDArray[np.bool_]:
    """Whether each of an artifact's episodes is kept ``(N,)``: those that no selection judges are."""
    left_out = [reader.find(identity) for identity, keep in read_judgements(folders).items() if not keep]
    kept = np.ones(len(reader), bool)
    kept[left_out] = False
    return kept


def read_judgements(folders: Iterable[Path]) -> dict[str, bool]:
    """By its id, whether an episode that some selections judge is kept: if all of those that judge it keep it."""
    judged: dict[str, bool] = {}
    for folder in folders:
        for row in read_selection(folder):
            judged[row.episode_id] = judged.get(row.episode_id, True) and row.keep
    return judged
