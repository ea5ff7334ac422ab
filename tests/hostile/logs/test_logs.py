"""Each hostile log is rejected by itself, in one sentence, and the others go on."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest

from flows.loop import find_logs
from juicer.artifacts.store import ArtifactStore
from juicer.demonstration.ingestion import Ingestion, IngestionConfig
from juicer.demonstration.log import OperatorLog
from juicer.errors import RejectedLog
from juicer.storage.episodes import EpisodeReader
from juicer.storage.recordings import read_recordings
from stages.ingest import ingest
from stages.runtime.execution import perform_here
from stages.runtime.session import Session

Entries = dict[str, bytes]
Forge = Callable[[Entries], bytes]


def odd_files(folder: Path) -> dict[str, str]:
    """Put things into a folder that are no files; gives a part of the reason by name."""
    os.mkfifo(folder / "odd-pipe.npz")
    (folder / "odd-folder.npz").mkdir()
    (folder / "odd-zero.npz").symlink_to("/dev/zero")
    (folder / "odd-terminal.npz").symlink_to("/dev/tty")
    (folder / "odd-nowhere.npz").symlink_to(folder / "nowhere")
    (folder / "odd-circle.npz").symlink_to(folder / "odd-circle.npz")
    (folder / "odd-hidden.npz").touch(mode=0)
    with (folder / "odd-large.npz").open("wb") as file:
        file.truncate(2**40)
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(os.path.relpath(folder / "odd-socket.npz"))
    return {
        "odd-pipe.npz": "it is not a plain file",
        "odd-folder.npz": "it is not a plain file",
        "odd-zero.npz": "it is not a plain file",
        "odd-terminal.npz": "cannot be read",
        "odd-nowhere.npz": "it is a link to a file that does not exist",
        "odd-circle.npz": "symbolic links",
        "odd-hidden.npz": "",
        "odd-large.npz": "it is larger than",
        "odd-socket.npz": "cannot be read",
    }


@pytest.fixture(scope="module")
def ingestion() -> Ingestion:
    return Ingestion(IngestionConfig(task="one_leg"))


def check_sentence(sentence: str) -> None:
    assert 5 < len(sentence) < 700
    assert sentence.isprintable(), sentence


def test_there_are_as_many_as_were_asked_for(hostile_logs: Mapping[str, Forge]):
    assert len(hostile_logs) >= 254


def test_a_hostile_log_is_rejected_in_one_short_sentence(
    ingestion: Ingestion, entries: Entries, tmp_path: Path, hostile_log: Forge
):
    path = tmp_path / "log.npz"
    path.write_bytes(hostile_log(entries))
    with pytest.raises(RejectedLog) as rejection:
        ingestion.ingest(path, "log.npz")
    check_sentence(str(rejection.value))


@pytest.mark.parametrize("seed", range(20))
def test_flipped_bytes_are_noticed_or_change_nothing(packed: bytes, recording: OperatorLog, tmp_path: Path, seed: int):
    """Some bytes of an archive, as its times, mean nothing."""
    content = bytearray(packed)
    rng = np.random.default_rng(seed)
    for position in rng.integers(len(content), size=8).tolist():
        content[position] ^= 1 << int(rng.integers(8))
    (tmp_path / "log.npz").write_bytes(content)
    try:
        episode = Ingestion(IngestionConfig(task="one_leg")).ingest(tmp_path / "log.npz", "log.npz").episode
    except RejectedLog as rejection:
        check_sentence(str(rejection))
    else:
        kept = episode.steps["sim_state"]
        assert kept.tobytes() in recording.steps["sim_state"].tobytes() or len(kept) < len(recording)


def test_what_is_only_unusual_is_read(entries: Entries, recording: OperatorLog, tmp_path: Path, unusual_log: Forge):
    (tmp_path / "log.npz").write_bytes(unusual_log(entries))
    demonstration = Ingestion(IngestionConfig(task="one_leg")).ingest(tmp_path / "log.npz", "log.npz")
    kept = demonstration.kept
    np.testing.assert_array_equal(demonstration.episode.steps["sim_state"], recording.steps["sim_state"][kept])
    device = demonstration.episode.record.device or ""
    assert device.isprintable()
    assert len(device) <= 220


BOUNDED = """
import resource, sys
from pathlib import Path
from juicer.demonstration.ingestion import IngestionConfig, UnusableLog, ingest
list(ingest([], IngestionConfig(task="one_leg")))
now = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (now + 2**26, now + 2**26))
for result in ingest(sorted(Path(sys.argv[1]).glob("*.npz")), IngestionConfig(task="one_leg")):
    assert isinstance(result, UnusableLog), result
    print(result.source, result.reason)
"""


def test_bombs_take_no_memory(bombs_only: Mapping[str, Forge], entries: Entries, tmp_path: Path):
    folder = tmp_path / "bombs"
    folder.mkdir()
    for number, forge in enumerate(bombs_only.values()):
        (folder / f"{number}.npz").write_bytes(forge(entries))
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])}
    found = subprocess.run(
        [sys.executable, "-c", BOUNDED, str(folder)], capture_output=True, text=True, env=environment, check=False
    )
    assert found.returncode == 0, found.stderr
    assert "memory" not in found.stdout.lower()
    assert len(found.stdout.splitlines()) == len(bombs_only)


def test_a_folder_of_hostile_logs_and_one_good_one_gives_one_demonstration(
    hostile_logs: Mapping[str, Forge], entries: Entries, good: Path, tmp_path: Path
):
    folder = tmp_path / "logs"
    folder.mkdir()
    expected = odd_files(folder)
    for number, forge in enumerate(hostile_logs.values()):
        (folder / f"hostile-{number:03}.npz").write_bytes(forge(entries))
    (folder / "good.npz").write_bytes(good.read_bytes())
    session = Session(ArtifactStore(tmp_path / "store"), perform_here)
    ref = ingest(session, files=find_logs(folder), config=IngestionConfig(task="one_leg"))
    facts = session.store.manifest(ref).summary
    assert (facts["episodes"], facts["rejected"]) == (1, len(hostile_logs) + len(expected))
    recordings = {entry.log: entry for entry in read_recordings(session.store.open(ref))}
    assert [name for name, entry in recordings.items() if entry.episode is not None] == ["good.npz"]
    for name, reason in expected.items():
        assert reason in recordings[name].reason
    assert len(EpisodeReader(session.store.open(ref))) == 1
    assert ingest(session, files=find_logs(folder), config=IngestionConfig(task="one_leg")) == ref


@pytest.mark.slow
def test_the_command_line_lists_every_rejection_of_such_a_folder(
    hostile_logs: Mapping[str, Forge], entries: Entries, good: Path, tmp_path: Path
):
    (tmp_path / "logs").mkdir()
    expected = odd_files(tmp_path / "logs")
    for number, forge in enumerate(hostile_logs.values()):
        (tmp_path / "logs" / f"hostile-{number:03}.npz").write_bytes(forge(entries))
    (tmp_path / "logs" / "good.npz").write_bytes(good.read_bytes())
    (tmp_path / "mine.yaml").write_text(f"logs: {tmp_path / 'logs'}\n")
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[3]), "JUICER_DATA": str(tmp_path / "data")}
    found = subprocess.run(
        [sys.executable, "-m", "flows.command.cli", "stage", "ingest", "--config", str(tmp_path / "mine.yaml")],
        capture_output=True,
        text=True,
        env=environment,
        cwd=tmp_path,
        check=False,
    )
    assert found.returncode == 0, found.stderr
    assert "Traceback" not in found.stderr
    assert f"and {len(hostile_logs) + len(expected) - 20} more; see `juicer show`" in found.stderr
    assert sum(line.startswith("hostile-") for line in found.stdout.splitlines()) == len(hostile_logs)
    (kept,) = (line for line in found.stdout.splitlines() if line.startswith("good.npz"))
    assert kept.split()[:3] == ["good.npz", "0", "300"]
