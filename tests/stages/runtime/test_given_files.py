"""What a stage is given from outside the store is hashed as it was read."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from juicer.errors import ConfigError
from stages.runtime.execution import execute
from stages.runtime.given_files import MOST_BYTES, check_unchanged, describe_files


def test_one_bad_file_of_many_is_described_by_the_reason(tmp_path: Path):
    (tmp_path / "good").write_text("words")
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "dangling").symlink_to(tmp_path / "nowhere")
    (tmp_path / "folder").mkdir()
    with (tmp_path / "large").open("wb") as file:
        file.truncate(MOST_BYTES + 1)
    described = describe_files("files", tuple(sorted(tmp_path.iterdir())), one_of_many=True)
    assert described.pop("files/good").isalnum()
    assert described == {
        "files/dangling": "unreadable: No such file or directory",
        "files/folder": "unreadable: it is not a plain file",
        "files/large": "unreadable: it is larger than 1,073,741,824 bytes",
        "files/pipe": "unreadable: it is not a plain file",
    }


@pytest.mark.parametrize("name", ["pipe", "/dev/zero", "."])
def test_the_only_file_of_its_role_must_be_readable(tmp_path: Path, name: str):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(ConfigError, match="cannot be read: it is not a plain file"):
        describe_files("labels", (tmp_path / name,), one_of_many=False)


def test_a_name_that_would_steer_a_terminal_is_escaped(tmp_path: Path):
    (tmp_path / "\x1b[31mred").write_text("")
    assert list(describe_files("files", (tmp_path / "\x1b[31mred",), one_of_many=True)) == [r"files/\x1b[31mred"]


def test_a_change_is_named():
    check_unchanged({"files/a": "1"}, {"files/a": "1"})
    with pytest.raises(ConfigError, match="file 'a' changed while it was read; run it again"):
        check_unchanged({"files/a": "1"}, {"files/a": "2"})


def test_a_file_that_changes_between_hashing_and_reading_makes_no_artifact(toys, session, tmp_path: Path):
    (note := tmp_path / "note").write_text("one")
    call = toys.count.prepare(session, episodes=(), notes=(note,), config=toys.ToyConfig())
    note.write_text("two")
    with pytest.raises(ConfigError, match="file 'note' changed while it was read"):
        execute(call, session)
    assert session.store.refs() == []
