"""How evaluation episodes ended, one row each."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Self

import pyarrow as pa

from juicer.episode import Episode, Outcome
from juicer.errors import ArtifactError
from juicer.storage.tables import MILESTONES, read_table, write_table
from juicer.text import printable

EXAMPLES = "examples"
"""Folder of an evaluation with a few whole episodes; the others can be computed again from their seeds."""

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
