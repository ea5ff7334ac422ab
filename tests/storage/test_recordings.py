"""A step of a recording is found in its episode, and the other way round."""

from __future__ import annotations

from pathlib import Path

import pytest

from juicer.errors import ArtifactError
from juicer.storage.recordings import Recording, read_recordings, write_recordings

KEPT = Recording("a.npz", episode=0, num_steps=10, kept=(2, 3, 4, 7, 8))
REJECTED = Recording("b.npz", reason="the operator marked it as failed")


def test_the_table_reads_back_as_it_was_written(tmp_path: Path):
    write_recordings(tmp_path, [KEPT, REJECTED])
    assert read_recordings(tmp_path) == [KEPT, REJECTED]


def test_stretches_of_dropped_steps_are_told_by_their_ends():
    assert KEPT.dropped == ((0, 1), (5, 6), (9, 9))
    assert KEPT.num_dropped == 5
    assert Recording("c", episode=1, num_steps=3, kept=(0, 1, 2)).dropped == ()
    assert (REJECTED.dropped, REJECTED.num_dropped) == ((), 0)


@pytest.mark.parametrize(("log_step", "step"), [(0, 0), (2, 0), (4, 2), (5, 2), (6, 2), (7, 3), (9, 4)])
def test_a_dropped_step_counts_as_the_one_before(log_step: int, step: int):
    assert KEPT.episode_step(log_step) == step


def test_a_step_that_is_not_there_is_refused():
    for recording, step in ((KEPT, 10), (KEPT, -1), (REJECTED, 0)):
        with pytest.raises(ValueError, match=f"'{recording.log}' has no step {step}"):
            recording.episode_step(step)


def test_a_folder_without_the_table_is_named(tmp_path: Path):
    with pytest.raises(ArtifactError, match=r"recordings\.parquet"):
        read_recordings(tmp_path)
