"""The command line: one sentence for every mistake, an exit status to rely on, JSON for machines."""

from __future__ import annotations

import json
import math
import os
import re
import resource
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import av
import numpy as np
import pytest

import juicer
from flows.command.choice import Choice
from flows.command.cli import call
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.store import ArtifactStore
from juicer.episode import STATE_KEY, Outcome
from juicer.storage.episodes import write_episodes

NOTHING_FOUND = {"damaged": {}, "stray": {}, "litter": {}, "unreadable": {}, "unseen": []}
SMOKE = Path(__file__).parents[3] / "configs" / "smoke.yaml"


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
    command = [sys.executable, "-X", "importtime", "-m", "flows.command.cli", "--help"]
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    assert resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before < 1
    assert "lineage" in result.stdout
    for heavy in ("torch", "mujoco", "prefect", "mlflow", "numpy", "pydantic"):
        assert f"| {heavy}\n" not in result.stderr


def test_listing_does_not_import_what_it_does_not_need(store, episodes):
    command = [sys.executable, "-X", "importtime", "-m", "flows.command.cli", "ls"]
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    assert episodes.id in result.stdout
    for heavy in ("torch", "mujoco", "prefect", "mlflow", "zarr"):
        assert f"| {heavy}\n" not in result.stderr


def test_artifacts_are_listed_shown_and_traced(capsys, store, episodes, annotations):
    assert [entry["ref"] for entry in json_of(capsys, "ls")] == [str(episodes), str(annotations)]
    assert [entry["ref"] for entry in json_of(capsys, "ls", "episodes")] == [str(episodes)]
    assert json_of(capsys, "show", episodes.id[:6])["summary"] == {"episodes": 1, "steps": 5}
    assert json_of(capsys, "lineage", annotations.id)[-1] == {"ref": str(annotations), "parents": [str(episodes)]}
    assert json_of(capsys, "verify") == {"checked": 2, **NOTHING_FOUND}
    for command in (["ls"], ["show", episodes.id], ["lineage", annotations.id], ["verify", episodes.id]):
        assert call(command) == 0
    assert f"└─ {episodes}" in capsys.readouterr().out


def test_empty_store_is_no_error(capsys, store):
    assert call(["ls"]) == 0
    assert "no artifacts" in capsys.readouterr().out
    assert json_of(capsys, "verify") == {"checked": 0, **NOTHING_FOUND}


def test_damage_is_found_and_fails_the_command(capsys, store, episodes):
    (store.open(episodes) / "episodes.parquet").write_bytes(b"damaged")
    assert "1 of 1 artifacts are damaged" in complaint(capsys, "verify")
    assert call(["verify", "--json"]) == 1
    assert str(episodes) in json.loads(capsys.readouterr().out)["damaged"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["show", "abc"], "no artifact answers to 'abc'"),
        (["run", "gone.yaml"], "'gone.yaml' does not exist"),
        (["run", str(SMOKE), "--set", "evaluat.episodes=3"], "'evaluat'; did you mean 'evaluate'?"),
        (["run", str(SMOKE), "--set", "evaluate.episodes"], "must look like key=value"),
        (["run", str(SMOKE), "--set", "logs=/nowhere"], "folder '/nowhere' does not exist"),
        (["stage", "train", "-c", str(SMOKE), "--condition", "bc"], "needs what dataset makes, and the store lacks it"),
        (["explain", "train", "-c", str(SMOKE), "--seed", "5"], "the study has no seed 5"),
        (["explain", "report", "-c", str(SMOKE)], "the report needs evaluations that are not in the store"),
        (["report", str(SMOKE), "-o", "page.pdf"], "page 'page.pdf' must end in .md or .html"),
        (["report", str(SMOKE), "-o", "/nowhere/page.md"], "folder '/nowhere' for the page does not exist"),
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


@pytest.mark.parametrize("facts", [{}, {"tasks": []}, {"tasks": "lamp"}, {"tasks": 3}])
def test_checkpoint_that_does_not_say_its_task_is_told(capsys, store, facts):
    recipe = Recipe("train", "checkpoint", config={"a": 1})
    with store.create(recipe) as draft:
        (draft.path / "policy.json").write_text("{}")
        draft.summary |= facts
    assert "does not say what it was trained for; choose a task with --task" in complaint(
        capsys, "evaluate", recipe.ref.id
    )


def test_misspelt_variable_is_refused(capsys, store, monkeypatch):
    monkeypatch.setenv("JUICER_STOER", "x")
    assert "did you mean 'JUICER_STORE'?" in complaint(capsys, "ls")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["ls", "--jsno"], "No such option: --jsno"),
        (["ls", "episode"], "'episode' is none of logs, episodes, .*; did you mean 'episodes'"),
        (["stage", "trian", "--config", "smoke"], "'trian' is none of annotate, .*; did you mean 'train'"),
        (["run", "smoke", "--task", "lmap"], "'lmap' is none of one_leg, .*; did you mean 'lamp'"),
        (["evaluate", "abc", "--randomness", "lo"], "'lo' is none of low, med, high; did you mean 'low'"),
        (["evaluate", "abc", "--episodes", "3", "-n", "4"], "'--episodes' is given 2 times and counts once"),
        (["evaluate", "abc", "--randomness", "low", "--randomness", "med"], "'--randomness' is given 2 times"),
        (["replay", "abc", "--video", "a.mp4", "--camera", "back"], "'back' is none of front, wrist"),
        (["stage", "train", "-c", "smoke", "--config", "demo"], "'--config' is given 2 times"),
        (["show", "abc", "e\x1b[2Jxtra\nline"], r"extra argument.*e\\x1b\[2Jxtra\\(n|x0a)line"),
    ],
)
def test_wrong_call_ends_with_2_and_says_what_would_be_right(capsys, store, arguments, message):
    assert call(arguments) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert re.search(message, line)
    assert call([*arguments, "--json"]) == 2
    captured = capsys.readouterr()
    content = json.loads(captured.out)
    assert captured.err == ""
    assert set(content) == {"error", "kind"}
    assert content["kind"] == "UsageError"
    assert re.search(message, content["error"])


@pytest.mark.parametrize(
    ("arguments", "kind", "message"),
    [
        (["run", "smoke", "--set", "seeds=1"], "ConfigError", "seeds: must be a list, e.g. [1], got 1"),
        (["show", "abc"], "ArtifactNotFound", "no artifact answers to 'abc'"),
        (["run", "dem"], "ConfigError", "did you mean 'demo'"),
    ],
)
def test_for_machines_an_error_is_json_too(capsys, store, arguments, kind, message):
    assert call([*arguments, "--json"]) == 1
    captured = capsys.readouterr()
    content = json.loads(captured.out)
    assert (captured.err, content["kind"]) == ("", kind)
    assert message in content["error"]


def test_foreign_text_in_an_error_does_not_steer_the_terminal(capsys, store):
    line = complaint(capsys, "show", "a\x1b]0;title\x07\nb" + "x" * 100_000)
    assert "\x1b" not in line
    assert r"a\x1b]0;title\x07\nb" in line
    assert len(line) < 11_000


def test_several_conditions_and_seeds_of_a_study_count_together(store):
    choice = Choice.of("study_one_leg", None, None, ["ta_ci", "bc"], [1, 0])
    (run,) = choice.runs()
    assert (list(run.conditions), run.seeds) == (["bc", "ta_ci"], (0, 1))


def test_several_tasks_count_together_in_the_order_of_the_configuration():
    runs = Choice.of("table_vi", None, ["lamp", "one_leg"], ["bc"], [0]).runs()
    assert [run.task for run in runs] == ["one_leg", "lamp"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "demo", "--condition", "bc", "--condition", "bc"], "--condition: each may be given only once"),
        (["run", "demo", "--seed", "0", "--seed", "0"], "--seed: each may be given only once"),
        (["explain", "train", "-c", "table_vi", "--task", "lamp", "--task", "lamp"], "--task: each may be given only"),
        (["run", "demo", "--condition", "bc", "--condition", "ci"], "the study has no condition 'ci'"),
        (
            ["run", "paper_study", "--condition", "ten_bc"],
            "task round_table has no condition 'ten_bc'; add --task one_leg, which has it",
        ),
        (["run", "smoke", "--condition", "tai"], "the study has no condition 'tai'; did you mean 'ta_ci'?"),
        (["run", "laptop", "--condition", "tai"], "condition: unknown condition 'tai'; did you mean 'ta'?"),
        (["config", "laptop", "--set", "tasks=[one_leg]", "--task", "lamp"], "no task 'lamp'; valid: one_leg"),
        (["run", "demo", "--task", "lamp"], "no task 'lamp'; --set task=lamp makes it one of that task"),
        (["run", "laptop", "--seed", "0", "--seed", "1"], "is of one model: give one seed, or make it a study"),
        (["run", "demo", "--set", "seeds=[1]", "--set", "seeds=[2]"], "--set 'seeds=[2]' undoes --set 'seeds=[1]'"),
        (["run", "demo", "--set", "record.seed=1", "--set", "record={seed: 2}"], "undoes --set 'record.seed=1'"),
    ],
)
def test_nothing_that_is_given_is_left_out_without_a_word(capsys, store, arguments, message):
    assert message in complaint(capsys, *arguments)


def test_version_is_told(capsys):
    assert call(["--version"]) == 0
    assert capsys.readouterr().out == f"juicer {juicer.__version__}\n"


def test_help_names_the_choices_and_gives_an_example(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "300")
    assert call(["run", "--help"]) == 0
    told = capsys.readouterr().out
    for words in (
        "demo, demo_images, human_operator, image_ablation",
        "e.g. ta_ci",
        "[one_leg|",
        "--set evaluate.episodes=200",
    ):
        assert words in told


@pytest.mark.parametrize(
    ("words", "found"),
    [
        ("juicer ev", {"evaluate"}),
        ("juicer run de", {"demo", "demo_images"}),
        ("juicer run demo --condition ta", {"ta", "ta_ci"}),
        ("juicer evaluate x --randomness m", {"med"}),
        ("juicer stage tr", {"train"}),
    ],
)
def test_shell_completes_commands_and_choices(words, found, tmp_path):
    variables = {
        "_JUICER_COMPLETE": "complete_bash",
        "COMP_WORDS": words,
        "COMP_CWORD": str(len(words.split()) - 1),
    }
    command = [sys.executable, "-m", "flows.command.cli"]
    result = subprocess.run(
        command, capture_output=True, text=True, check=True, env={**os.environ, **variables}, timeout=60
    )
    assert set(result.stdout.split()) == found


@pytest.mark.parametrize(
    "command",
    [
        ["run", str(SMOKE)],
        ["stage", "record", "-c", str(SMOKE)],
        ["evaluate", "0123456789abcdef"],
        ["repair", "0123456789abcdef"],
        ["serve"],
    ],
    ids=lambda command: command[0],
)
def test_device_that_is_not_there_is_named_before_anything_starts(capsys, store, monkeypatch, command):
    monkeypatch.setenv("JUICER_DEVICE", "cuda:99")
    assert "there is no device 'cuda:99' here, " in complaint(capsys, *command)
    assert not Path(store.url).exists()


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
