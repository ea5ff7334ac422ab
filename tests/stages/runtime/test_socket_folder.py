"""Sockets of a process go where their paths fit, and go away with it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from juicer.errors import ServiceUnavailable
from stages.runtime import socket_folder
from stages.runtime.socket_folder import make_socket_folder

PROGRAM = """
import sys
from multiprocessing.util import get_temp_dir
from stages.runtime.socket_folder import make_socket_folder
folder = make_socket_folder()
assert get_temp_dir().startswith(f"{folder}/")
print(folder, flush=True)
sys.stdin.read()
"""


def start(base: Path) -> tuple[subprocess.Popen[str], Path]:
    environment = {**os.environ, "TMPDIR": str(base), "PYTHONPATH": os.pathsep.join(sys.path)}
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
    )
    assert process.stdout
    return process, Path(process.stdout.readline().strip())


def test_it_ends_with_its_process():
    process, folder = start(Path("/tmp"))
    assert folder.parent == Path("/tmp")
    assert folder.is_dir()
    process.communicate("")
    assert not folder.exists()


def test_what_a_killed_process_left_is_removed_by_the_next_and_a_living_one_keeps_its_own():
    killed, left = start(Path("/tmp"))
    living, kept = start(Path("/tmp"))
    killed.send_signal(signal.SIGKILL)
    killed.wait()
    assert left.is_dir()
    third, _ = start(Path("/tmp"))
    assert not left.exists()
    assert kept.is_dir()
    for process in (living, third):
        process.communicate("")


def test_a_path_too_long_for_sockets_gives_way_to_a_short_one(tmp_path: Path):
    base = tmp_path / ("t" * 120)
    base.mkdir()
    process, folder = start(base)
    assert folder.parent in (Path("/tmp"), Path("/var/tmp"))
    process.communicate("")


def test_a_disk_without_a_place_for_it_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "nowhere"))
    monkeypatch.setattr(socket_folder, "LONGEST_BASE", 1000)
    with pytest.raises(ServiceUnavailable, match=r"no temporary folder can be made in .*nowhere"):
        make_socket_folder()
