"""Payloads that somebody else composed, in a store that is shared, are refused in one sentence."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from juicer.errors import ArtifactError
from juicer.storage.curves import CURVES_FILE, read_curves
from juicer.storage.episodes import EpisodeReader, write_episodes
from juicer.storage.evaluations import EvaluationRow, read_evaluation, write_evaluation
from juicer.storage.selections import SelectionRow, read_selection, write_selection

Edit = Callable[[dict[str, Any]], None]

DEEP = b"[" * 100_000


@pytest.fixture
def folder(tmp_path: Path, episode_factory: Callable[..., Any]) -> Path:
    write_episodes(tmp_path, [episode_factory(5), episode_factory(6)], {})
    return tmp_path


def use(folder: Path) -> None:
    """All that is ever read of episodes."""
    reader = EpisodeReader(folder)
    assert len(reader.records) == len(reader)
    for index in range(len(reader)):
        reader.read(index)
    reader.steps("action")


def complaint(folder: Path) -> str:
    with pytest.raises(ArtifactError) as caught:
        use(folder)
    sentence = str(caught.value)
    assert sentence.isprintable()
    assert len(sentence) < 600
    return sentence


EDITS: dict[str, Edit] = {
    "absurd size": lambda array: array.update(shape=[10**15, *array["shape"][1:]]),
    "more steps": lambda array: array.update(shape=[array["shape"][0] + 1, *array["shape"][1:]]),
    "no axis": lambda array: array.update(shape=[]),
    "negative size": lambda array: array.update(shape=[-1, *array["shape"][1:]]),
    "text for a size": lambda array: array.update(shape="\x1b[2J"),
    "absurd chunks": lambda array: array["chunk_grid"]["configuration"].update(
        chunk_shape=[10**12, *array["shape"][1:]]
    ),
    "another type": lambda array: array.update(data_type="complex128"),
    "no type": lambda array: array.update(data_type="x" * 10**6),
    "another version": lambda array: array.update(zarr_format=99),
    "a group": lambda array: array.update(node_type="group"),
    "unknown codec": lambda array: array.update(codecs=[{"name": "evil"}]),
    "nothing": lambda array: array.clear(),
}


@pytest.mark.parametrize("array", ["data/action", "data/sim_state", "final/part_poses", "meta/episode_ends"])
@pytest.mark.parametrize("edit", EDITS)
def test_an_array_that_juicer_would_not_write_is_refused(folder: Path, array: str, edit: str) -> None:
    path = folder / "episodes.zarr" / array / "zarr.json"
    content = json.loads(path.read_text())
    EDITS[edit](content)
    path.write_text(json.dumps(content))
    assert str(folder) in complaint(folder)


@pytest.mark.parametrize("content", [DEEP, b"", b"[]", b"null", b"\xff", b'{"zarr_format": 3}', b" " * (2**24 + 1)])
@pytest.mark.parametrize("place", ["zarr.json", "data/action/zarr.json", "data/action/c/0/0"])
def test_a_file_of_nonsense_is_refused(folder: Path, place: str, content: bytes) -> None:
    (folder / "episodes.zarr" / place).write_bytes(content)
    complaint(folder)


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        (None, "its arrays are not described"),
        ([{"name": "../..", "shape": [], "dtype": "float32", "role": "reward"}], "cannot be the name of an array"),
        (
            [{"name": "secret", "shape": [3], "dtype": "float32", "role": "action"}],
            "array 'data/secret' cannot be opened",
        ),
    ],
)
def test_a_schema_of_other_arrays_is_refused(folder: Path, arrays: Any, words: str) -> None:
    path = folder / "episodes.zarr" / "zarr.json"
    content = json.loads(path.read_text())
    content["attributes"]["arrays"] = arrays
    path.write_text(json.dumps(content))
    assert words in complaint(folder)


def test_an_array_that_is_missing_is_named(folder: Path) -> None:
    shutil.rmtree(folder / "episodes.zarr" / "data" / "reward")
    assert "array 'data/reward' cannot be opened" in complaint(folder)


def test_a_table_of_other_episodes_is_refused(
    folder: Path, tmp_path: Path, episode_factory: Callable[..., Any]
) -> None:
    (tmp_path / "other").mkdir()
    write_episodes(tmp_path / "other", [episode_factory(7)], {})
    shutil.copy(tmp_path / "other" / "episodes.parquet", folder / "episodes.parquet")
    assert "its table and its arrays are of different episodes" in complaint(folder)


@pytest.mark.parametrize(
    ("column", "value", "words"),
    [
        ("outcome", "\x1b[2J", "is not a valid Outcome"),
        ("source", "", "is not a valid Source"),
        ("task", None, "'task'"),
        ("episode_id", "0123456789abcdef", "two of its episodes have one id"),
    ],
)
def test_a_table_with_values_that_mean_nothing_is_refused(
    folder: Path, column: str, value: str | None, words: str
) -> None:
    path = folder / "episodes.parquet"
    table = pq.read_table(path)
    place = table.schema.get_field_index(column)
    changed = table.set_column(place, table.schema.field(place), pa.array([value] * 2, pa.string()))
    pq.write_table(changed, path)
    assert words in complaint(folder)


def test_tables_of_results_with_values_that_mean_nothing_are_refused(tmp_path: Path) -> None:
    write_evaluation(tmp_path, [EvaluationRow(0, 1, "won", 1, 6)])  # type: ignore[arg-type]
    with pytest.raises(ArtifactError, match="'won' is not a valid Outcome"):
        read_evaluation(tmp_path)
    write_selection(tmp_path, [SelectionRow("a0", None, "success")])  # type: ignore[arg-type]
    with pytest.raises(ArtifactError, match="lacks values in its column 'keep'"):
        read_selection(tmp_path)


def test_a_table_of_absurdly_many_rows_is_not_unpacked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_selection(tmp_path, [SelectionRow(str(index), True, "success") for index in range(11)])
    monkeypatch.setattr("juicer.storage.tables.MOST_ROWS", 10)
    with pytest.raises(ArtifactError, match="has 11 rows; juicer reads 10"):
        read_selection(tmp_path)


@pytest.mark.parametrize("content", [DEEP, b"[]", b"{", b'{"a": 1}', b'{"a": [[1]]}', b'{"a": [["x", 2]]}', b"\xff"])
def test_curves_that_juicer_would_not_write_are_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / CURVES_FILE).write_bytes(content)
    with pytest.raises(ArtifactError, match=r"curves\.json' holds no curves that juicer wrote"):
        read_curves(tmp_path)


def test_curves_may_have_holes(tmp_path: Path) -> None:
    (tmp_path / CURVES_FILE).write_text('{"loss": [[1, 0.5], [2, NaN]]}')
    steps, values = read_curves(tmp_path)["loss"]
    assert steps == (1, 2)
    assert math.isnan(values[1])
