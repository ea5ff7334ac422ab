"""Small tables as Parquet with fixed schemas: annotations, selections, evaluations."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal, Self

import pyarrow as pa
import pyarrow.parquet as pq

from juicer.episode import Episode, Outcome
from juicer.errors import ArtifactError

MILESTONES = pa.map_(pa.string(), pa.int32())
"""Step at which each milestone was first reached, by name."""

EXAMPLES = "examples"
"""Folder of an evaluation with a few whole episodes; the others can be computed again from their seeds."""

_ANNOTATIONS = pa.schema(
    {
        "episode": pa.int32(),
        "step": pa.int32(),
        "critical_state": pa.int32(),
        "author": pa.string(),
        "confidence": pa.float64(),
    }
)
_SELECTION = pa.schema({"episode": pa.int32(), "keep": pa.bool_(), "reason": pa.string()})
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
    """A critical state: index of the episode in its artifact, step within it, which critical state of the task it is.

    ``confidence`` lies between zero and one; a human's annotation has one.
    """

    episode: int
    step: int
    critical_state: int
    author: Literal["proposed", "human"]
    confidence: float


@dataclass(frozen=True)
class SelectionRow:
    """Whether an episode of an artifact is kept, and why."""

    episode: int
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
    return [EvaluationRow(**{**row, "outcome": Outcome(row["outcome"])}) for row in rows]


def write_table(path: Path, schema: pa.Schema, rows: Iterable[Mapping[str, Any]]) -> None:
    """Write rows as Parquet; their names and types must be those of the schema."""
    pq.write_table(pa.Table.from_pylist(list(rows), schema=schema), path)


def read_table(path: Path, schema: pa.Schema) -> list[dict[str, Any]]:
    """Read every row of a Parquet file; map columns become dictionaries.

    Raises:
        ArtifactError: If the file is missing or has another schema.
    """
    try:
        table = pq.read_table(path)
    except (FileNotFoundError, pa.ArrowInvalid):
        raise ArtifactError(f"'{path}' is not a Parquet table that juicer wrote") from None
    if not table.schema.equals(schema):
        raise ArtifactError(
            f"'{path}' has the columns {table.schema.names} of another version; expected {schema.names}"
        )
    rows: list[dict[str, Any]] = table.to_pylist(maps_as_pydicts="strict")
    return rows
