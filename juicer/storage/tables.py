"""Small tables as Parquet with fixed schemas: annotations, selections, evaluations."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal, Self

import pyarrow as pa
import pyarrow.parquet as pq

from juicer.episode import Episode, Outcome
from juicer.errors import ArtifactError
from juicer.text import printable

MOST_ROWS = 10_000_000
"""Of a table: far more than any has, and no more than memory holds."""

MILESTONES = pa.map_(pa.string(), pa.int32())
"""Step at which each milestone was first reached, by name."""

EXAMPLES = "examples"
"""Folder of an evaluation with a few whole episodes; the others can be computed again from their seeds."""

_ANNOTATIONS = pa.schema(
    {
        "episode_id": pa.string(),
        "step": pa.int32(),
        "critical_state": pa.int32(),
        "author": pa.string(),
        "confidence": pa.float64(),
    }
)
_SELECTION = pa.schema({"episode_id": pa.string(), "keep": pa.bool_(), "reason": pa.string()})
_EVALUATION = pa.schema(
    {
        "episode": pa.int32(),
        "seed": pa.int64(),
        "outcome": pa.string(),
        "parts_assembled": pa.int32(),
        "length": pa.int32(),
        "milestones": MILESTONES,
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


@dataclass(frozen=True)
class SelectionRow:
    """Whether an episode of an artifact is kept, and why."""

    episode_id: str
    keep: bool
    reason: str


@dataclass(frozen=True)
class EvaluationRow:
    """How one evaluation episode ended; ``length`` in steps, ``milestones`` by the step that first reached them."""

    episode: int
    seed: int
    outcome: Outcome
    parts_assembled: int
    length: int
    milestones: Mapping[str, int] = field(default_factory=dict)

    @classmethod
    def of(cls, index: int, episode: Episode) -> Self:
        """Row of the episode of a number."""
        facts = episode.record
        return cls(index, facts.seed, facts.outcome, facts.parts_assembled, len(episode), facts.milestones)


def write_annotations(folder: Path, rows: Iterable[Annotation]) -> None:
    """Write ``annotations.parquet``."""
    write_table(folder / "annotations.parquet", _ANNOTATIONS, map(asdict, rows))


def read_annotations(folder: Path) -> list[Annotation]:
    """Read ``annotations.parquet``."""
    return [Annotation(**row) for row in read_table(folder / "annotations.parquet", _ANNOTATIONS)]


def write_selection(folder: Path, rows: Iterable[SelectionRow]) -> None:
    """Write ``selection.parquet``."""
    write_table(folder / "selection.parquet", _SELECTION, map(asdict, rows))


def read_selection(folder: Path) -> list[SelectionRow]:
    """Read ``selection.parquet``."""
    return [SelectionRow(**row) for row in read_table(folder / "selection.parquet", _SELECTION)]


def write_evaluation(folder: Path, rows: Iterable[EvaluationRow]) -> None:
    """Write ``evaluation.parquet``."""
    write_table(folder / "evaluation.parquet", _EVALUATION, map(asdict, rows))


def read_evaluation(folder: Path) -> list[EvaluationRow]:
    """Read ``evaluation.parquet``."""
    rows = read_table(folder / "evaluation.parquet", _EVALUATION)
    try:
        return [EvaluationRow(**{**row, "outcome": Outcome(row["outcome"])}) for row in rows]
    except ValueError as error:
        raise ArtifactError(f"'{folder}' is not an evaluation that juicer wrote: {printable(error)}") from None


def write_table(path: Path, schema: pa.Schema, rows: Iterable[Mapping[str, Any]]) -> None:
    """Write rows as Parquet; their names and types must be those of the schema."""
    pq.write_table(pa.Table.from_pylist(list(rows), schema=schema), path)


def read_table(
    path: Path, schema: pa.Schema, optional: Collection[str] = (), older: pa.Schema | None = None
) -> list[dict[str, Any]]:
    """Read every row of a Parquet file; map columns become dictionaries.

    Args:
        path: The file.
        schema: Names and types of its columns.
        optional: Columns that need not have a value in every row.
        older: What an earlier juicer wrote: what it lacks is None, what there is no place for today is left out.

    Raises:
        ArtifactError: If the file is missing, has another schema, lacks values, or has absurdly many rows.
    """
    try:
        with pq.ParquetFile(path) as file:
            if file.metadata.num_rows > MOST_ROWS:
                raise ArtifactError(f"'{path}' has {file.metadata.num_rows:,} rows; juicer reads {MOST_ROWS:,}")
            table = file.read()
    except (OSError, pa.ArrowException):
        raise ArtifactError(f"'{path}' is not a Parquet table that juicer wrote") from None
    if older is not None and table.schema.equals(older):
        for name in schema.names:
            if name not in older.names:
                table = table.append_column(name, pa.nulls(len(table), schema.field(name).type))
        table = table.select(schema.names)
    if not table.schema.equals(schema):
        names = printable(table.schema.names)
        raise ArtifactError(f"'{path}' has the columns {names} of another version; expected {schema.names}")
    for name in schema.names:
        if name not in optional and table.column(name).null_count:
            raise ArtifactError(f"'{path}' lacks values in its column '{name}'; make its artifact again")
    try:
        rows: list[dict[str, Any]] = table.to_pylist(maps_as_pydicts="strict")
    except (pa.ArrowException, KeyError, ValueError) as error:
        raise ArtifactError(f"'{path}' is not a table that juicer wrote: {printable(error)}") from None
    return rows
