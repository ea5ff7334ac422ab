"""Which recording became which demonstration, and which of its steps: a table beside the episodes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path

import pyarrow as pa

from juicer.storage.tables import read_table, write_table

RECORDINGS = "recordings.parquet"

_SCHEMA = pa.schema(
    {
        "log": pa.string(),
        "episode": pa.int32(),
        "episode_id": pa.string(),
        "num_steps": pa.int32(),
        "kept": pa.list_(pa.int32()),
        "reason": pa.string(),
    }
)

_OLDER = _SCHEMA.remove(_SCHEMA.get_field_index("episode_id"))


@dataclass(frozen=True)
class Recording:
    """What became of one operator log.

    Attributes:
        log: Its name.
        episode: Number of the demonstration that it became; None if it was rejected.
        episode_id: Its id.
        num_steps: Its steps; None if it was rejected.
        kept: Its steps that became the episode's steps, in order; the operator was idle at the others.
        reason: Why it was rejected, as one sentence; empty if it was not.
    """

    log: str
    episode: int | None = None
    episode_id: str | None = None
    num_steps: int | None = None
    kept: tuple[int, ...] = ()
    reason: str = ""

    @property
    def num_dropped(self) -> int:
        """How many of its steps were dropped, because the operator was idle."""
        return (self.num_steps or 0) - len(self.kept)

    @property
    def dropped(self) -> tuple[tuple[int, int], ...]:
        """Stretches of dropped steps: the first and the last of each."""
        edges = [-1, *self.kept, self.num_steps or 0]
        return tuple((before + 1, after - 1) for before, after in pairwise(edges) if after - before > 1)


def write_recordings(folder: Path, rows: Iterable[Recording]) -> None:
    """Write ``recordings.parquet``."""
    write_table(folder / RECORDINGS, _SCHEMA, map(asdict, rows))


def read_recordings(folder: Path) -> list[Recording]:
    """Read ``recordings.parquet``.

    Raises:
        ArtifactError: If it is missing or has another schema.
    """
    return list(_read(folder))


def _read(folder: Path) -> Iterator[Recording]:
    for row in read_table(folder / RECORDINGS, _SCHEMA, ("episode", "episode_id", "num_steps"), _OLDER):
        yield Recording(**{**row, "kept": tuple(row["kept"])})
