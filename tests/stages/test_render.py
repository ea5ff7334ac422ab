"""Images as columns: the bytes of what happened, whoever draws them and however often; and what is told instead."""

from __future__ import annotations

import shutil
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.demonstration.ingestion import IngestionConfig
from juicer.demonstration.log import write_log
from juicer.episode import Outcome
from juicer.errors import (
    ArtifactError,
    DamagedArtifact,
    InvalidEpisode,
    RenderingUnavailable,
    StateMissing,
    StoreNotWritable,
)
from juicer.imaging import recorded
from juicer.sim.env import AssemblyEnv
from juicer.sim.sections import joint_positions
from juicer.storage.columns import COLUMNS, ColumnReader
from juicer.storage.dataset import read_dataset
from juicer.storage.episodes import EpisodeReader, write_episodes
from juicer.tasks.registry import TASK_NAMES
from juicer.training.mixing import DatasetConfig
from juicer.views import GazeCrop, View
from stages.dataset import dataset
from stages.ingest import ingest
from stages.render import RenderConfig, render
from stages.runtime.execution import perform_here
from stages.runtime.machine import Machine
from stages.runtime.session import Session
from stages.select import SelectConfig, select

SMALL = View(camera="front", crop=GazeCrop(), width=32, height=24)
WRIST = View(camera="wrist", width=40, height=40, supersampling=2)


class Disk(NamedTuple):
    free: int


@pytest.fixture(scope="module")
def demonstrations(tmp_path_factory, recording) -> tuple[ArtifactStore, ArtifactRef]:
    path = tmp_path_factory.mktemp("logs") / "0.npz"
    write_log(path, recording)
    store = ArtifactStore(tmp_path_factory.mktemp("store"))
    return store, ingest(session(store), files=(path,), config=IngestionConfig(task="one_leg"))


def session(store: ArtifactStore, workers: int = 1) -> Session:
    return Session(store, perform_here, machine=Machine(workers=workers))


def stored(store: ArtifactStore, name: str, *episodes) -> ArtifactRef:
    with store.create(Recipe("by hand", "episodes", config={"name": name})) as draft:
        write_episodes(draft.path, episodes, {})
    return draft.ref


@pytest.fixture(scope="module")
def images(drawing, demonstrations) -> ArtifactRef:
    store, episodes = demonstrations
    return render(session(store), episodes=episodes, config=RenderConfig(view=SMALL))


@pytest.mark.parametrize("view", [SMALL, WRIST], ids=str)
def test_a_rendered_frame_is_the_frame_when_it_happened(drawing, demonstrations, view):
    store, episodes = demonstrations
    columns = render(session(store), episodes=episodes, config=RenderConfig(view=view))
    reader = EpisodeReader(store.open(episodes), [store.open(columns)])
    episode = reader.read(0)
    env = AssemblyEnv("one_leg")
    env.set_state(episode.steps["sim_state"][0])
    for step in range(25):
        np.testing.assert_array_equal(episode.steps[view.name][step], env.render_view(view))
        if not episode.steps["continuous"][step]:
            env.set_state(episode.steps["sim_state"][step + 1])
        else:
            env.step(episode.steps["action"][step])
    env.close()


def test_every_step_is_drawn_once_and_its_column_tells_what_drew_it(demonstrations, images):
    store, episodes = demonstrations
    reader = ColumnReader(store.open(images))
    summary = store.manifest(images).summary
    assert reader.steps(SMALL.name).shape == (summary["images"], 24, 32, 3)
    assert summary["images"] == EpisodeReader(store.open(episodes)).episode_ends[-1]
    assert summary["view"] == "front gaze 32x24"
    assert summary["headline"] == f"{summary['images']} images, front gaze 32x24"
    (drawn_by,) = summary["drawn_by"]
    assert reader.drawn_by == (drawn_by,)
    renderer, _, version = drawn_by.rpartition(", ")
    assert renderer
    assert version[0].isdecimal()


def test_several_processes_draw_the_same_as_one(demonstrations, images, tmp_path, monkeypatch):
    store, episodes = demonstrations
    monkeypatch.setattr(recorded, "BATCH", 50)
    with recorded.drawing_of(EpisodeReader(store.open(episodes)), (SMALL,), workers=2) as drawn:
        (again,) = drawn.episodes()
    np.testing.assert_array_equal(again[SMALL.name], ColumnReader(store.open(images)).steps(SMALL.name))


def test_of_rollouts_that_a_selection_judges_only_those_kept_are_drawn(drawing, demonstrations, images):
    store, episodes = demonstrations
    kept = EpisodeReader(store.open(episodes)).read(0)
    failed = replace(
        kept,
        record=replace(kept.record, episode_id="", outcome=Outcome.TIMEOUT, seed=1),
        steps={name: values[:9] for name, values in kept.steps.items()},
    )
    rollouts = stored(store, "rollouts", failed, kept)
    selection = select(session(store), episodes=rollouts, config=SelectConfig())
    columns = render(session(store), episodes=rollouts, selections=(selection,), config=RenderConfig(view=SMALL))
    assert store.manifest(columns).summary["images"] == len(kept)
    joined = EpisodeReader(store.open(rollouts), [store.open(columns)])
    assert joined.covered.tolist() == [False, True]
    np.testing.assert_array_equal(joined.read(1).steps[SMALL.name], ColumnReader(store.open(images)).steps(SMALL.name))
    with pytest.raises(ArtifactError, match=r"cover 1 of the 2 episodes of [0-9a-f]{16}, and not number 0"):
        joined.read(0)
    mixed = {"episodes": (rollouts,), "columns": (columns,), "config": DatasetConfig()}
    (row,) = read_dataset(store.open(dataset(session(store), selections=(selection,), **mixed)))
    assert row.episode_id == kept.record.episode_id
    with pytest.raises(
        ArtifactError, match=r"do not cover its episode .* give the selections that they were made with"
    ):
        dataset(session(store), **mixed)


def test_progress_counts_steps(drawing, demonstrations):
    store, episodes = demonstrations
    reader, told = EpisodeReader(store.open(episodes)), []
    with recorded.drawing_of(reader, (SMALL,), workers=1) as drawn:
        list(drawn.episodes(lambda done, total, **facts: told.append((done, total))))
    total = int(reader.episode_ends[-1])
    assert told[-1] == (total, total)
    assert told == sorted(told)


def test_a_disk_too_small_is_told_before_with_both_sizes(drawing, demonstrations, monkeypatch):
    store, episodes = demonstrations
    monkeypatch.setattr(shutil, "disk_usage", lambda path: Disk(1000))
    with pytest.raises(
        StoreNotWritable, match=r"images of wrist whole 96x96 .* take about \d+\.\d MB, .* 0\.0 MB left"
    ):
        render(session(store), episodes=episodes, config=RenderConfig(view=View(camera="wrist")))


def test_the_room_to_learn_from_them_is_asked_for_before_they_are_drawn(drawing, demonstrations, monkeypatch):
    store, episodes = demonstrations
    view = View(camera="wrist", width=64, height=48)
    raw = int(EpisodeReader(store.open(episodes)).episode_ends[-1]) * 64 * 48 * 3
    monkeypatch.setattr(shutil, "disk_usage", lambda path: Disk(raw))
    with pytest.raises(StoreNotWritable, match="and the same unpacked while a policy learns from them, take about"):
        render(session(store), episodes=episodes, config=RenderConfig(view=view))
    monkeypatch.setattr(shutil, "disk_usage", lambda path: Disk(2 * raw))
    render(session(store), episodes=episodes, config=RenderConfig(view=view))


def test_the_size_that_is_told_is_that_on_the_disk(demonstrations, images):
    store, episodes = demonstrations
    with recorded.drawing_of(EpisodeReader(store.open(episodes)), (SMALL,), workers=1) as drawn:
        told = drawn.stored_bytes()
    written = sum(entry.bytes for entry in store.manifest(images).files if "/c/" in entry.path)
    assert written / 3 < told < 3 * written


def test_episodes_without_simulator_states_are_refused(demonstrations, episode_factory):
    store, _ = demonstrations
    episode = episode_factory(5)
    foreign = type(episode)(
        record=episode.record,
        steps={name: values for name, values in episode.steps.items() if name != "sim_state"},
        final={name: values for name, values in episode.final.items() if name != "sim_state"},
        schema=type(episode.schema)(tuple(spec for spec in episode.schema if spec.name != "sim_state")),
    )
    with pytest.raises(StateMissing, match="holds no simulator state"):
        render(session(store), episodes=stored(store, "foreign", foreign), config=RenderConfig(view=SMALL))


def test_states_of_another_scene_are_refused(drawing, demonstrations, episode_factory):
    store, _ = demonstrations
    short = stored(store, "short", episode_factory(5))
    with pytest.raises(InvalidEpisode, match="not simulator states of one_leg"):
        render(session(store), episodes=short, config=RenderConfig(view=SMALL))


def test_without_opengl_a_sentence_says_what_to_install(demonstrations, monkeypatch):
    store, episodes = demonstrations
    monkeypatch.setenv("MUJOCO_GL", "disable")
    with pytest.raises(RenderingUnavailable, match=r"set MUJOCO_GL=egl with libegl1 and"):
        render(session(store), episodes=episodes, config=RenderConfig(view=WRIST.model_copy(update={"width": 33})))


def test_a_damaged_chunk_of_images_is_found(demonstrations, images, tmp_path):
    store, _ = demonstrations
    folder = tmp_path / "columns" / images.id
    shutil.copytree(store.open(images), folder)
    chunk = next(path for path in (folder / COLUMNS / "data").rglob("c/*/*/*/*") if path.is_file())
    content = bytearray(chunk.read_bytes())
    content[100] ^= 1
    chunk.write_bytes(content)
    with pytest.raises(DamagedArtifact, match="has other content than when it was written"):
        ColumnReader(folder).steps(SMALL.name)


@pytest.mark.parametrize("task", TASK_NAMES)
def test_joint_positions_are_those_of_the_state(task):
    env = AssemblyEnv(task)
    env.reset(seed=0)
    (positions,) = joint_positions(env.task, env.get_state()[None])
    np.testing.assert_array_equal(positions, env.data.qpos)
