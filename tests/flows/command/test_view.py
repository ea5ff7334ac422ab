"""``juicer view`` writes what Rerun opens, and says what is missing before anything is computed."""

from __future__ import annotations

import importlib.util
import json
import subprocess

import pytest

from flows.command.cli import call
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.store import ArtifactStore
from juicer.storage.episodes import write_episodes

HAS_RERUN = importlib.util.find_spec("rerun") is not None


@pytest.fixture
def episodes(tmp_path, monkeypatch, insertions):
    monkeypatch.setenv("JUICER_DATA", str(tmp_path / "data"))
    with ArtifactStore(tmp_path / "data").create(Recipe("ingest", "episodes")) as draft:
        write_episodes(draft.path, insertions, {})
    return draft.ref


def test_of_several_devices_the_first_computes_an_episode_again(monkeypatch, episodes):
    class Chosen(Exception):
        pass

    def choose(*arguments):
        raise Chosen(arguments[-1])

    monkeypatch.setenv("JUICER_DEVICE", "cuda:1,cuda:0")
    for command in ("replay", "view"):
        monkeypatch.setattr(f"flows.command.{command}.choose", choose)
    monkeypatch.setattr("juicer.imaging.rerun_recording.require_rerun", lambda: None)
    for command in ("replay", "view"):
        with pytest.raises(Chosen, match=r"^cuda:1$"):
            call([command, episodes.id])


@pytest.mark.skipif(HAS_RERUN, reason="Rerun is installed")
def test_without_rerun_it_is_said_how_to_get_it(capsys, tmp_path, episodes):
    path = tmp_path / "episode.rrd"
    assert call(["view", episodes.id, "-o", str(path)]) == 1
    assert capsys.readouterr().err == (
        "juicer: Rerun is not installed; `pip install --editable '.[rerun]'` in juicer's repository adds it\n"
    )
    assert not path.exists()


@pytest.mark.skipif(not HAS_RERUN, reason="needs the extra 'rerun'")
@pytest.mark.usefixtures("drawing")
def test_recording_is_one_that_rerun_reads(capsys, tmp_path, episodes, insertions):
    from juicer.imaging.rerun_recording import viewer

    path = tmp_path / "episode.rrd"
    assert call(["view", episodes.id, "-k", "1", "-o", str(path), "--no-open", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"recording": str(path), "frames": len(insertions[1]) + 1}
    assert [each.name for each in tmp_path.glob("*.rrd")] == ["episode.rrd"]
    subprocess.run([viewer(), "rrd", "verify", path], check=True, capture_output=True)


@pytest.mark.skipif(not HAS_RERUN, reason="needs the extra 'rerun'")
@pytest.mark.parametrize(
    ("place", "message"),
    [("episode.mp4", "must end in .rrd"), ("gone/episode.rrd", "for the recording does not exist")],
)
def test_recording_that_cannot_be_written_is_refused_with_a_sentence(capsys, tmp_path, episodes, place, message):
    assert call(["view", episodes.id, "-o", str(tmp_path / place), "--no-open"]) == 1
    assert message in capsys.readouterr().err
