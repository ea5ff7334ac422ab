"""``juicer analyse`` takes what belongs to the task that it is asked about, and refuses a figure at once."""

from __future__ import annotations

import pytest

from flows.command.analyse import demonstrations_behind
from flows.command.cli import call
from flows.running.plan import calls_of, plan
from flows.runs import load_runs
from juicer.artifacts.store import ArtifactStore
from juicer.errors import ArtifactNotFound
from juicer.tasks.registry import TASK_NAMES


def test_samples_are_drawn_at_demonstrations_of_the_task_that_is_asked_about(tmp_path):
    store = ArtifactStore(tmp_path / "data")
    planned = plan(store, load_runs("table_vi")[0].narrowed(["multitask"], [0]))
    for entry in planned:
        if not entry.exists:
            with store.create(entry.call.recipe):
                pass
    checkpoint = calls_of(planned, "train")[-1].ref
    for task in TASK_NAMES:
        ref = demonstrations_behind(store, checkpoint, task)
        assert store.manifest(ref).recipe.config["task"] == task
    with pytest.raises(ArtifactNotFound, match="the demonstrations of cabinet behind checkpoint/"):
        demonstrations_behind(store, checkpoint, "cabinet")


@pytest.mark.parametrize("name", ["nowhere/figure.png", "figure.jpg"])
def test_a_figure_that_cannot_be_written_is_refused_before_anything_is_computed(name, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("JUICER_DATA", str(tmp_path / "data"))
    assert call(["analyse", "sampling", "0123", "--figure", str(tmp_path / name)]) == 1
    assert "figure" in capsys.readouterr().err
    assert not (tmp_path / "data").exists()


def test_an_analysis_that_was_taken_away_is_told(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("JUICER_DATA", str(tmp_path / "data"))
    planned = plan(ArtifactStore(tmp_path / "data"), load_runs("smoke")[0])
    for entry in planned:
        with ArtifactStore(tmp_path / "data").create(entry.call.recipe):
            pass
    checkpoint = calls_of(planned, "train")[-1].ref
    wrong = ["--set", "analyses={}"]
    assert call(["analyse", "monitor", checkpoint.id, "--task", "one_leg", *wrong]) == 1
    assert "--set: analyses must hold 'monitor', which is asked for" in capsys.readouterr().err
