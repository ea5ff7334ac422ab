"""Tables: what is read is what was written."""

from __future__ import annotations

from pathlib import Path

import pytest

from juicer.episode import Outcome
from juicer.errors import ArtifactError
from juicer.storage.tables import (
    Annotation,
    EvaluationRow,
    SelectionRow,
    read_annotations,
    read_evaluation,
    read_selection,
    write_annotations,
    write_evaluation,
    write_selection,
)


def test_annotations_read_back(tmp_path: Path) -> None:
    rows = [Annotation("a0", 417, 0, "proposed", 0.93), Annotation("b1", 398, 0, "human", 1.0)]
    write_annotations(tmp_path, rows)
    assert read_annotations(tmp_path) == rows


def test_selections_read_back(tmp_path: Path) -> None:
    rows = [SelectionRow("a0", True, "success"), SelectionRow("b1", False, "timeout: leg never lifted")]
    write_selection(tmp_path, iter(rows))
    assert read_selection(tmp_path) == rows


def test_evaluations_read_back_with_their_types(tmp_path: Path) -> None:
    rows = [
        EvaluationRow(0, 1_000_000_007, Outcome.SUCCESS, 1, 431, {"leg_lifted": 120, "screwed": 431}),
        EvaluationRow(1, 1_000_000_008, Outcome.PART_LOST, 0, 77),
    ]
    write_evaluation(tmp_path, rows)
    assert read_evaluation(tmp_path) == rows
    assert isinstance(read_evaluation(tmp_path)[0].outcome, Outcome)


def test_empty_tables_read_back(tmp_path: Path) -> None:
    write_annotations(tmp_path, [])
    assert read_annotations(tmp_path) == []


def test_a_missing_table_is_named(tmp_path: Path) -> None:
    with pytest.raises(ArtifactError, match=r"annotations\.parquet' is not a Parquet table"):
        read_annotations(tmp_path)


def test_a_truncated_table_is_named(tmp_path: Path) -> None:
    write_annotations(tmp_path, [Annotation("a0", 1, 0, "human", 1.0)])
    path = tmp_path / "annotations.parquet"
    path.write_bytes(path.read_bytes()[:-9])
    with pytest.raises(ArtifactError, match="is not a Parquet table"):
        read_annotations(tmp_path)


def test_a_table_with_other_columns_is_refused(tmp_path: Path) -> None:
    write_selection(tmp_path, [SelectionRow("a0", True, "success")])
    (tmp_path / "selection.parquet").rename(tmp_path / "annotations.parquet")
    with pytest.raises(ArtifactError, match="has the columns"):
        read_annotations(tmp_path)
