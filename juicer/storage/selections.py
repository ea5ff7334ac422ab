"""Which episodes of an artifact are kept, one row each."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

import pyarrow as pa

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


def read_judgements(folders: Iterable[Path]) -> dict[str, bool]:
    """By its id, whether an episode that some selections judge is kept: if all of those that judge it keep it."""
    judged: dict[str, bool] = {}
    for folder in folders:
        for row in read_selection(folder):
            judged[row.episode_id] = judged.get(row.episode_id, True) and row.keep
    return judged
