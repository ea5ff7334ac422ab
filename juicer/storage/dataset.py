"""A dataset: an index of the episodes to learn from, one Parquet row each. It copies no arrays."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

import pyarrow as pa

from juicer.artifacts.ref import is_id
from juicer.episode import Source
from juicer.errors import ArtifactError
from juicer.storage.tables import read_table, write_table
from juicer.text import printable

DATASET = "dataset.parquet"

_SCHEMA = pa.schema(
    {
        "episodes": pa.string(),
        "episode_id": pa.string(),
        "source": pa.string(),
        "task": pa.string(),
        "family": pa.string(),
        "weight": pa.float64(),
        "columns": pa.list_(pa.string()),
    }
)


@dataclass(frozen=True)
class DatasetRow:
    """An episode to learn from.

    Attributes:
        episodes: Id of the artifact that it is in.
        episode_id: Its own id.
        source: Where it comes from.
        task: Assembly task that it shows.
        family: A label that it shares with the demonstration it was grown from, and with all others grown from that.
            A family is never split between training and validation, lest one validates the other.
        weight: How often each of its windows is learned from, as compared with those of weight one.
        columns: Ids of the artifacts with columns of its steps.
    """

    episodes: str
    episode_id: str
    source: Source
    task: str
    family: str
    weight: float = 1.0
    columns: tuple[str, ...] = ()


def write_dataset(folder: Path, rows: Iterable[DatasetRow]) -> None:
    """Write ``dataset.parquet``; the order is that in which the episodes are read."""
    write_table(folder / DATASET, _SCHEMA, map(asdict, rows))


def read_dataset(folder: Path) -> list[DatasetRow]:
    """Read ``dataset.parquet``.

    Raises:
        ArtifactError: If it is not one that juicer wrote, or names no artifacts.
    """
    rows = read_table(folder / DATASET, _SCHEMA)
    try:
        found = [
            DatasetRow(**{**row, "source": Source(row["source"]), "columns": tuple(row["columns"])}) for row in rows
        ]
    except ValueError as error:
        raise _refusal(folder, printable(error)) from None
    for row in found:
        for name in (row.episodes, *row.columns):
            if not is_id(str(name)):
                raise _refusal(folder, f"'{printable(name)}' is not the id of an artifact")
        if not (math.isfinite(row.weight) and row.weight > 0):
            raise _refusal(folder, f"an episode has the weight {row.weight}")
    if len({row.episode_id for row in found}) < len(found):
        raise _refusal(folder, "an episode is there twice")
    return found


def grouped(rows: Iterable[DatasetRow]) -> list[list[DatasetRow]]:
    """Rows that share an artifact, columns and task, in the order in which these first occur."""
    groups: dict[object, list[DatasetRow]] = {}
    for row in rows:
        groups.setdefault((row.episodes, row.columns, row.task), []).append(row)
    return list(groups.values())


def _refusal(folder: Path, reason: str) -> ArtifactError:
    return ArtifactError(f"'{folder}' is not a dataset that juicer wrote: {reason}")
