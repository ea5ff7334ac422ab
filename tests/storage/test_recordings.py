"""What became of each recording."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from juicer.errors import ArtifactError
from juicer.storage.recordings import Recording, read_recordings, write_recordings

KEPT = Recording("a.npz", episode=0, episode_id="0123456789abcdef", num_steps=10, kept=(2, 3, 4, 7, 8))
REJECTED = Recording("b.npz", reason="the operator marked it as failed")


def test_the_table_reads_back_as_it_was_written(tmp_path: Path):
    write_recordings(tmp_path, [KEPT, REJECTED])
    assert read_recordings(tmp_path) == [KEPT, REJECTED]


def test_stretches_of_dropped_steps_are_told_by_their_ends():
    assert KEPT.dropped == ((0, 1), (5, 6), (9, 9))
    assert KEPT.num_dropped == 5
    assert Recording("c", episode=1, num_steps=3, kept=(0, 1, 2)).dropped == ()
    assert (REJECTED.dropped, REJECTED.num_dropped) == ((), 0)


def test_the_table_of_an_earlier_juicer_is_read_too(tmp_path: Path):
    write_recordings(tmp_path, [KEPT, REJECTED])
    path = tmp_path / "recordings.parquet"
    pq.write_table(pq.read_table(path).drop_columns(["episode_id"]), path)
    assert read_recordings(tmp_path) == [replace(KEPT, episode_id=None), REJECTED]


def test_a_folder_without_the_table_is_named(tmp_path: Path):
    with pytest.raises(ArtifactError, match=r"recordings\.parquet"):
        read_recordings(tmp_path)
