"""Critical states become a file to correct, and episodes are found by what they are called."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flows.command.cli import call
from juicer.annotation.labels import Label, read_labels
from juicer.annotation.rewriting import write_labels
from juicer.annotation.versions import read_versions, versions_path
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.episode import DEMONSTRATION, SIMULATOR, Episode, Role, Schema
from juicer.storage.annotations import Annotation, write_annotations
from juicer.storage.episodes import write_episodes


@pytest.fixture
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ArtifactStore:
    monkeypatch.setenv("JUICER_DATA", str(tmp_path / "data"))
    return ArtifactStore(tmp_path / "data")


@pytest.fixture
def demonstration(episode_factory) -> Episode:
    plain = episode_factory(5, seed=3)
    numbers = {"recorded_step": np.array([2, 3, 4, 7, 8], np.int32), "continuous": np.array([1, 1, 0, 1, 1], bool)}
    record = replace(plain.record, log="demo.npz")
    return replace(plain, record=record, steps={**plain.steps, **numbers}, schema=DEMONSTRATION)


@pytest.fixture
def episodes(store: ArtifactStore, demonstration: Episode) -> ArtifactRef:
    recipe = Recipe("ingest", "episodes", config={"a": 1})
    with store.create(recipe) as draft:
        write_episodes(draft.path, [demonstration], {})
    return recipe.ref


@pytest.fixture
def annotations(store: ArtifactStore, episodes: ArtifactRef, demonstration: Episode) -> ArtifactRef:
    recipe = Recipe("annotate", "annotations", inputs={"episodes": (episodes,)})
    with store.create(recipe) as draft:
        write_annotations(draft.path, [Annotation(demonstration.record.episode_id, 3, 0, "proposed", 0.5)])
    return recipe.ref


def complaint(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert call(list(arguments)) == 1
    return capsys.readouterr().err


def test_annotations_are_written_with_the_steps_of_the_recording(
    annotations: ArtifactRef, demonstration: Episode, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    path = tmp_path / "labels.csv"
    assert call(["labels", annotations.id, str(path)]) == 0
    assert path.read_text() == f"recording,step,critical_state\n{demonstration.record.episode_id},7,0\n"
    assert "exists already" in complaint(capsys, "labels", annotations.id, str(path))
    assert "cannot be written: No such file" in complaint(
        capsys, "labels", annotations.id, str(tmp_path / "a" / "b.csv")
    )
    for name, reason in (("labels.csv/b.csv", "Not a directory"), (f"{'b' * 300}.csv", "File name too long")):
        assert f"cannot be written: {reason}" in complaint(capsys, "labels", annotations.id, str(tmp_path / name))
    assert "must end in .csv, .jsonl, .yaml or .yml" in complaint(
        capsys, "labels", annotations.id, str(tmp_path / "a.txt")
    )


def test_a_file_of_numbers_is_written_anew(
    episodes: ArtifactRef,
    annotations: ArtifactRef,
    demonstration: Episode,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
):
    old, new = tmp_path / "old.csv", tmp_path / "new.csv"
    old.write_text("episode,step,critical_state\n0,3,0\n")
    assert call(["labels", episodes.id, str(new), "--numbered", str(old)]) == 0
    assert new.read_text() == f"recording,step,critical_state\n{demonstration.record.episode_id},7,0\n"
    assert "nobody has marked a critical state" in complaint(capsys, "labels", episodes.id, str(tmp_path / "b.csv"))
    assert "name those that the file numbers" in complaint(
        capsys, "labels", annotations.id, str(tmp_path / "b.csv"), "--numbered", str(old)
    )


@pytest.mark.parametrize("ending", ["csv", "jsonl", "yaml"])
def test_labels_go_in_as_what_somebody_said_and_come_out_again(
    store: ArtifactStore,
    episodes: ArtifactRef,
    demonstration: Episode,
    tmp_path: Path,
    ending: str,
    capsys: pytest.CaptureFixture[str],
):
    labels, out = tmp_path / f"in.{ending}", tmp_path / f"out.{ending}"
    write_labels(labels, [Label("demo.npz", 7, 0, "here")])
    for said in (1, 0):
        assert call(["labels", episodes.id, str(labels), "--import-as", "Ada"]) == 0
        assert f"one_leg.versions.jsonl: {said} critical states more" in capsys.readouterr().out
    (version,) = read_versions(versions_path(tmp_path / "data", "one_leg"))
    assert (version.episode, version.step, version.author) == (demonstration.record.episode_id, 7, "Ada")
    assert call(["labels", episodes.id, str(out)]) == 0
    (label,) = read_labels(out)
    assert (label.recording, label.step, label.critical_state) == (demonstration.record.episode_id, 7, 0)
    assert "must be plain text" in complaint(capsys, "labels", episodes.id, str(labels), "--import-as", "\x1b[31m")
    both = ("--import-as", "Ada", "--numbered", str(labels))
    assert "does not go with --import-as" in complaint(capsys, "labels", episodes.id, str(labels), *both)
    for label, reason in (
        (Label("nobody.npz", 7, 0, "here"), "no demonstration of a recording 'nobody.npz'"),
        (Label("demo.npz", 7, 1, "here"), "those that annotate.critical_states adds (grasp top, grasp leg, place top)"),
        (Label("demo.npz", 7, 4, "here"), "there is no critical state 4; the task has 1"),
    ):
        labels.unlink()
        write_labels(labels, [label])
        assert reason in complaint(capsys, "labels", episodes.id, str(labels), "--import-as", "Bob")


def test_an_episode_that_is_not_there_is_named(episodes: ArtifactRef, capsys: pytest.CaptureFixture[str]):
    assert "no episode of" in complaint(capsys, "replay", episodes.id, "-k", "nobody.npz")


def test_data_without_simulator_states_cannot_be_replayed(
    store: ArtifactStore, demonstration: Episode, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    schema = Schema(tuple(spec for spec in SIMULATOR if spec.role is not Role.STATE))
    steps, final = (
        {name: arrays[name] for name in names}
        for arrays, names in ((demonstration.steps, schema.names()), (demonstration.final, schema.ends))
    )
    recipe = Recipe("ingest", "episodes", config={"of": "another project"})
    with store.create(recipe) as draft:
        write_episodes(draft.path, [Episode(demonstration.record, steps, final, schema)], {})
    video = tmp_path / "video.mp4"
    told = complaint(capsys, "replay", recipe.ref.id, "-k", "demo.npz", "--video", str(video))
    assert "holds no simulator state, so none of its steps can be restored" in told
    assert not list(tmp_path.glob("*video*"))
