"""The command line: one sentence for every mistake, an exit status to rely on, JSON for machines."""

from __future__ import annotations

import json
import math
import resource
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import av
import numpy as np
import pytest

from flows.cli import call
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.store import ArtifactStore
from juicer.episode import STATE_KEY, Outcome
from juicer.storage.episodes import write_episodes

SMOKE = Path(__file__).parents[2] / "configs" / "smoke.yaml"


@pytest.fixture
def store(tmp_path, monkeypatch):
    monkeypatch.setenv("JUICER_DATA", str(tmp_path / "data"))
    return ArtifactStore(tmp_path / "data")


@pytest.fixture
def episodes(store, episode_factory):
    recipe = Recipe("ingest", "episodes", config={"a": 1})
    with store.create(recipe) as draft:
        write_episodes(draft.path, [episode_factory(5, seed=3)], {})
        draft.summary |= {"episodes": 1, "steps": 5}
    return recipe.ref


@pytest.fixture
def annotations(store, episodes):
    recipe = Recipe("annotate", "annotations", inputs={"episodes": (episodes,)})
    with store.create(recipe) as draft:
        (draft.path / "annotations.parquet").write_bytes(b"rows")
    return recipe.ref


def json_of(capsys, *arguments):
    assert call([*arguments, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def complaint(capsys, *arguments):
    assert call([*arguments]) == 1
    captured = capsys.readouterr()
    assert captured.out == ""
    (line,) = captured.err.splitlines()
    assert line.startswith("juicer: ")
    return line


def test_help_comes_at_once():
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    command = [sys.executable, "-X", "importtime", "-m", "flows.cli", "--help"]
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    assert resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before < 1
    assert "lineage" in result.stdout
    for heavy in ("torch", "mujoco", "prefect", "mlflow", "numpy", "pydantic"):
        assert f"| {heavy}\n" not in result.stderr


def test_listing_does_not_import_what_it_does_not_need(store, episodes):
    command = [sys.executable, "-X", "importtime", "-m", "flows.cli", "ls"]
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    assert episodes.id in result.stdout
    for heavy in ("torch", "mujoco", "prefect", "mlflow", "zarr"):
        assert f"| {heavy}\n" not in result.stderr


def test_artifacts_are_listed_shown_and_traced(capsys, store, episodes, annotations):
    assert [entry["ref"] for entry in json_of(capsys, "ls")] == [str(episodes), str(annotations)]
    assert [entry["ref"] for entry in json_of(capsys, "ls", "episodes")] == [str(episodes)]
    assert json_of(capsys, "show", episodes.id[:6])["summary"] == {"episodes": 1, "steps": 5}
    assert json_of(capsys, "lineage", annotations.id)[-1] == {"ref": str(annotations), "parents": [str(episodes)]}
    assert json_of(capsys, "verify") == {"checked": 2, "damaged": {}}
    for command in (["ls"], ["show", episodes.id], ["lineage", annotations.id], ["verify", episodes.id]):
        assert call(command) == 0
    assert f"└─ {episodes}" in capsys.readouterr().out


def test_empty_store_is_no_error(capsys, store):
    assert call(["ls"]) == 0
    assert "no artifacts" in capsys.readouterr().out
    assert json_of(capsys, "verify") == {"checked": 0, "damaged": {}}


def test_damage_is_found_and_fails_the_command(capsys, store, episodes):
    (store.open(episodes) / "episodes.parquet").write_bytes(b"damaged")
    assert "1 of 1 artifacts are damaged" in complaint(capsys, "verify")
    assert call(["verify", "--json"]) == 1
    assert str(episodes) in json.loads(capsys.readouterr().out)["damaged"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["ls", "episode"], "unknown kind of artifact 'episode'; did you mean 'episodes'?"),
        (["show", "abc"], "no artifact answers to 'abc'"),
        (["run", "gone.yaml"], "'gone.yaml' does not exist"),
        (["run", str(SMOKE), "--set", "evaluat.episodes=3"], "'evaluat'; did you mean 'evaluate'?"),
        (["run", str(SMOKE), "--set", "evaluate.episodes"], "must look like key=value"),
        (["run", str(SMOKE), "--set", "logs=/nowhere"], "folder '/nowhere' does not exist"),
        (["stage", "trian", "--config", str(SMOKE)], "unknown stage 'trian'; did you mean 'train'?"),
        (["stage", "train", "-c", str(SMOKE), "--condition", "bc"], "needs what ingest makes, and the store lacks it"),
        (["explain", "train", "-c", str(SMOKE), "--condition", "tai"], "unknown condition 'tai'; did you mean 'ta'?"),
        (["explain", "train", "-c", str(SMOKE), "--seed", "5"], "the study has no seed 5"),
        (["explain", "report", "-c", str(SMOKE)], "the report needs evaluations that are not in the store"),
    ],
)
def test_mistake_gets_one_sentence(capsys, store, arguments, message):
    assert message in complaint(capsys, *arguments)


def test_artifact_of_the_wrong_kind_is_named(capsys, store, episodes, annotations, tmp_path):
    assert "of kind 'episodes' but 'checkpoint' is needed" in complaint(capsys, "evaluate", episodes.id)
    video = str(tmp_path / "video.mp4")
    assert "holds no episodes to replay" in complaint(capsys, "replay", annotations.id, "--video", video)
    assert "has episodes 0 to 0, not 4" in complaint(capsys, "replay", episodes.id, "-k", "4", "--video", video)
    assert "has episodes 0 to 0, not -1" in complaint(capsys, "replay", episodes.id, "-k", "-1", "--video", video)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--video", "/nowhere/video.mp4"], "folder '/nowhere' for the video does not exist"),
        (["--video", "video.avi"], "video 'video.avi' must end in .mp4, .mov or .mkv"),
        (["--video", "folder.mp4"], "video 'folder.mp4' is a folder"),
        (["--camera", "frnt"], "unknown camera 'frnt'; did you mean 'front'?"),
        (["--size", "big"], "size 'big' must be the width and height of a camera's image, e.g. 480x360"),
        (["--size", "99999x99999"], "measures 160x120 to 1280x720 pixels, not 99999x99999"),
        (["--size", "1e3x1e3"], "size '1e3x1e3' must be"),
        (["--size", "-640x480"], "size '-640x480' must be"),
        (["--video", "v" * 300 + ".mp4"], "cannot be written: File name too long"),
    ],
)
def test_a_video_that_cannot_be_made_is_refused_before_anything_is_computed(
    capsys, store, episodes, tmp_path, monkeypatch, arguments, message
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder.mp4").mkdir()
    assert message in complaint(capsys, "replay", episodes.id, *arguments)
    assert not [path for path in tmp_path.iterdir() if path.name not in ("folder.mp4", "data")]


def test_a_demonstration_is_replayed_with_both_cameras_at_the_size_of_choice(
    capsys, store, insertions, tmp_path, monkeypatch, drawing
):
    monkeypatch.chdir(tmp_path)
    recipe = Recipe("ingest", "episodes", config={"of": "the simulator"})
    with store.create(recipe) as draft:
        write_episodes(draft.path, insertions, {})
    told = json_of(capsys, "replay", recipe.ref.id[:6], "-k", "1", "--size", "200x150", "--speed", "4")
    assert (told["video"], told["strip"]) == (f"{recipe.ref.id}-1.mp4", f"{recipe.ref.id}-1.png")
    assert (told["steps"], told["left_out"], told["seed"]) == (len(insertions[1]), 0, 1)
    with av.open(told["video"]) as video:
        stream = video.streams.video[0]
        frames = [*video.decode(video=0)]
        assert (stream.width, stream.average_rate) == (404, 20)
    assert len(frames) == 1 + math.ceil(len(insertions[1]) / 2)
    assert Path(told["strip"]).exists()


def test_replay_leaves_out_what_cannot_be_drawn_and_says_so(capsys, store, insertions, tmp_path, drawing):
    final = {**insertions[0].final, STATE_KEY: np.full_like(insertions[0].final[STATE_KEY], np.nan)}
    record = replace(insertions[0].record, outcome=Outcome.DIVERGED)
    recipe = Recipe("collect", "episodes", config={"of": "an explosion"})
    with store.create(recipe) as draft:
        write_episodes(draft.path, [replace(insertions[0], record=record, final=final)], {})
    arguments = ["--camera", "front", "--size", "160x120", "--video", str(tmp_path / "video.mp4")]
    assert call(["replay", recipe.ref.id, *arguments]) == 0
    assert "frames left out: 1, whose state is not finite" in capsys.readouterr().out


def test_misspelt_variable_is_refused(capsys, store, monkeypatch):
    monkeypatch.setenv("JUICER_STOER", "x")
    assert "did you mean 'JUICER_STORE'?" in complaint(capsys, "ls")


def test_wrong_call_shows_usage_and_ends_with_2(capsys):
    assert call(["ls", "--jsno"]) == 2
    assert "--jsno" in capsys.readouterr().err


def test_missing_stage_is_explained(capsys, store):
    (entry,) = json_of(capsys, "explain", "train", "-c", str(SMOKE), "--condition", "bc")
    assert not entry["hit"]
    assert call(["explain", "ingest", "-c", str(SMOKE)]) == 0
    assert "the stage has made no artifact before" in capsys.readouterr().out


def test_deployments_need_a_server(capsys, store, monkeypatch):
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    assert "start one with `juicer ui`" in complaint(capsys, "serve")


def test_port_in_use_is_named(capsys, store):
    import socket

    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = str(listener.getsockname()[1])
        assert f"port {port} for MLflow is in use" in complaint(capsys, "ui", "--mlflow-port", port)
