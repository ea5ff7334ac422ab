"""The index of what is learned from: read back exactly, and refused if juicer would not have written it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from juicer.episode import Source
from juicer.errors import ArtifactError
from juicer.storage.dataset import DatasetRow, grouped, read_dataset, write_dataset

FIRST, SECOND, IMAGES = "0" * 16, "1" * 16, "c" * 16
ROWS = [
    DatasetRow(FIRST, "a1", Source.TELEOP, "one_leg", "0/0", columns=(IMAGES,)),
    DatasetRow(SECOND, "b1", Source.ROLLOUT, "one_leg", "1/0", weight=0.25),
    DatasetRow(FIRST, "a2", Source.AUGMENTATION, "one_leg", "0/0", columns=(IMAGES,)),
]


def test_a_dataset_reads_back_exactly_in_its_order(tmp_path: Path) -> None:
    write_dataset(tmp_path, ROWS)
    assert read_dataset(tmp_path) == ROWS


def test_rows_of_one_artifact_come_together_in_the_order_in_which_artifacts_occur() -> None:
    assert grouped(ROWS) == [[ROWS[0], ROWS[2]], [ROWS[1]]]
    assert len(grouped([ROWS[0], replace(ROWS[2], task="lamp")])) == 2


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"episodes": "../../../etc"}, "is not the id of an artifact"),
        ({"episodes": "\x1b[2J" * 100}, "is not the id of an artifact"),
        ({"columns": ("..",)}, "is not the id of an artifact"),
        ({"columns": (None,)}, "is not the id of an artifact"),
        ({"weight": float("nan")}, "has the weight nan"),
        ({"weight": float("inf")}, "has the weight inf"),
        ({"weight": 0.0}, "has the weight 0"),
        ({"weight": -1.0}, "has the weight -1"),
        ({"source": "dream"}, "'dream' is not a valid Source"),
        ({"episode_id": "b1"}, "an episode is there twice"),
        ({"family": None}, "lacks values in its column 'family'"),
        ({"task": None}, "lacks values in its column 'task'"),
    ],
)
def test_a_dataset_that_juicer_would_not_write_is_refused(tmp_path: Path, changes: dict[str, Any], words: str) -> None:
    write_dataset(tmp_path, [replace(ROWS[0], **changes), ROWS[1]])
    with pytest.raises(ArtifactError, match=words) as caught:
        read_dataset(tmp_path)
    assert str(caught.value).isprintable()


@pytest.mark.parametrize("content", [b"", b"[" * 100_000, b"PAR1", b"\xff" * 100])
def test_a_dataset_of_nonsense_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "dataset.parquet").write_bytes(content)
    with pytest.raises(ArtifactError, match="is not a Parquet table that juicer wrote"):
        read_dataset(tmp_path)
