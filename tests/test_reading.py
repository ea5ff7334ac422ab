"""Only plain files are read, and only so much of them."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from juicer.reading import UnsuitableFile, read_bounded


def test_a_file_is_read_up_to_its_bound(tmp_path: Path):
    (tmp_path / "file").write_bytes(b"12345")
    assert read_bounded(tmp_path / "file", 5) == b"12345"
    with pytest.raises(UnsuitableFile, match="larger than 4 bytes"):
        read_bounded(tmp_path / "file", 4)


def test_a_file_that_somebody_appends_to_is_read_as_far_as_it_goes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "file").write_bytes(b"1")
    fstat = os.fstat

    def append_afterwards(descriptor: int) -> os.stat_result:
        status = fstat(descriptor)
        (tmp_path / "file").write_bytes(b"12345")
        return status

    monkeypatch.setattr("juicer.reading.os.fstat", append_afterwards)
    for most in (5, 100_000):
        (tmp_path / "file").write_bytes(b"1")
        assert read_bounded(tmp_path / "file", most) == b"12345"
    (tmp_path / "file").write_bytes(b"1")
    with pytest.raises(UnsuitableFile, match="larger than 4 bytes"):
        read_bounded(tmp_path / "file", 4)


def test_a_pipe_is_refused_without_waiting(tmp_path: Path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(UnsuitableFile, match="not a plain file"):
        read_bounded(tmp_path / "pipe", 10)


@pytest.mark.parametrize("path", ["/dev/zero", "/dev", "a\0b"])
def test_what_is_no_plain_file_is_refused(path: str):
    with pytest.raises(UnsuitableFile):
        read_bounded(Path(path), 10)


def test_a_missing_file_is_missing(tmp_path: Path):
    with pytest.raises(FileNotFoundError):
        read_bounded(tmp_path / "nowhere", 10)
