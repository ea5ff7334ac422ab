"""Which files of a folder are taken for operator logs."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from flows.loop import find_logs, get_demonstrations
from flows.loop_config import LoopConfig
from juicer.artifacts.store import ArtifactStore
from juicer.errors import ConfigError
from stages.runtime.session import NoRecord, Session


def test_everything_that_is_named_like_a_log_is_one_for_ingestion_to_judge(tmp_path: Path):
    for name in ("b.npz", "A.NPZ", "notes.txt", "c.npz.part"):
        (tmp_path / name).touch()
    (tmp_path / "folder.npz").mkdir()
    os.mkfifo(tmp_path / "pipe.npz")
    (tmp_path / "gone.npz").symlink_to(tmp_path / "nowhere")
    assert [path.name for path in find_logs(tmp_path)] == ["A.NPZ", "b.npz", "folder.npz", "gone.npz", "pipe.npz"]


def test_all_models_of_a_run_learn_from_the_logs_that_were_there_when_it_began(tmp_path: Path):
    def session():
        return Session(ArtifactStore(tmp_path / "store"), performer=lambda call, _: call.recipe.ref)

    folder = tmp_path / "recordings"
    folder.mkdir()
    (folder / "first.npz").write_bytes(b"a log")
    run, config = session(), LoopConfig(logs=folder)
    first = get_demonstrations(run.for_model("BC, seed 0", NoRecord()), config)
    (folder / "second.npz").write_bytes(b"another log")
    assert get_demonstrations(run.for_model("BC, seed 1", NoRecord()), config) == first
    assert get_demonstrations(session(), config) != first


def test_a_folder_without_logs_or_none_at_all_is_named(tmp_path: Path):
    (tmp_path / "file").touch()
    (tmp_path / "circle").symlink_to(tmp_path / "circle")
    with pytest.raises(ConfigError, match="holds no operator log"):
        find_logs(tmp_path)
    for name, reason in {"file": "does not exist", "nowhere": "does not exist", "circle": "cannot be read"}.items():
        with pytest.raises(ConfigError, match=f"logs: folder '.*{name}' {reason}"):
            find_logs(tmp_path / name)
    with pytest.raises(ConfigError, match=r"logs: folder '.*\\x00' cannot be read: it has an impossible name"):
        find_logs(tmp_path / "a\0")


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become somebody else")
def test_a_folder_that_may_not_be_read_is_said_to_be_so(tmp_path: Path):
    (tmp_path / "locked").mkdir(mode=0)
    for folder in (tmp_path, *tmp_path.parents[:2]):
        folder.chmod(0o755)
    os.seteuid(65534)
    try:
        with pytest.raises(ConfigError, match=r"locked' cannot be read: Permission denied"):
            find_logs(tmp_path / "locked")
    finally:
        os.seteuid(0)
