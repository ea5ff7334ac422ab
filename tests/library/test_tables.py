"""Tables show what the store holds, also where something of it is gone."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from juicer.artifacts.catalog import catalog_of
from juicer.artifacts.manifest import MANIFEST_NAME
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.store import ArtifactStore
from juicer.episode import ArraySpec, Episode, Outcome, Role
from juicer.errors import ArtifactError, ConfigError
from juicer.library.episodes import Episodes
from juicer.library.names import find
from juicer.library.tables import artifact_table, curve_table, lineage_table, model_table, step_table, task_table
from juicer.storage.episodes import write_episodes


def test_an_empty_store_has_empty_tables(tmp_path):
    store = ArtifactStore(tmp_path)
    assert len(artifact_table(store, None)) == len(artifact_table(store, "report")) == len(model_table(store)) == 0
    assert {"task", "condition", "seed", "success_rate", "checkpoint"} <= set(model_table(store).columns)
    with pytest.raises(ConfigError, match="did you mean 'report'"):
        artifact_table(store, "reports")


def test_facts_of_a_kind_are_columns_and_what_was_deleted_has_an_id(tmp_path):
    store = ArtifactStore(tmp_path)
    with store.create(Recipe("ingest", "episodes")) as data:
        data.summary |= {"episodes": 3, "device": "scripted", "rejections": {"a": "b"}, "finding": "few"}
    with store.create(Recipe("train", "checkpoint", inputs={"episodes": (data.ref,)})) as model:
        model.summary |= {"train/loss": 0.5}
    table = artifact_table(store, "episodes")
    assert (table.loc[data.ref.id, "episodes"], table.loc[data.ref.id, "device"]) == (3, "scripted")
    assert table.loc[data.ref.id, "headline"] == "few"
    assert "rejections" not in table.columns
    assert list(artifact_table(store, None)["stage"]) == ["ingest", "train"]
    assert str(table["finished"].dtype).endswith("UTC]")
    lineage = lineage_table(store, model.ref)
    assert list(lineage.index) == [data.ref.id, model.ref.id]
    assert lineage.loc[model.ref.id, "parents"] == [data.ref.id]
    store.set_aside(data.ref)
    assert pd.isna(lineage_table(store, model.ref).loc[data.ref.id, "stage"])


def test_the_next_process_reads_only_reports_for_its_tables_and_names(tmp_path, monkeypatch):
    store, evaluations = ArtifactStore(tmp_path), []
    for seed in range(3):
        with store.create(Recipe("train", "checkpoint", config={"seed": seed})) as model:
            pass
        with store.create(Recipe("evaluate", "evaluation", inputs={"checkpoint": (model.ref,)})) as evaluation:
            evaluation.summary |= {"success_rate": 0.1 * seed, "observes": "state"}
        evaluations.append(evaluation.ref)
    config = {"title": "study", "task": "one_leg", "rows": [{"condition": "bc", "seed": seed} for seed in range(3)]}
    with store.create(Recipe("report", "report", inputs={"evaluations": tuple(evaluations)}, config=config)):
        pass
    first = artifact_table(store, None), artifact_table(store, "evaluation"), model_table(store)
    catalog_of.cache_clear()
    read = []
    manifest = ArtifactStore.manifest
    monkeypatch.setattr(ArtifactStore, "manifest", lambda self, ref: read.append(ref.kind) or manifest(self, ref))
    second = artifact_table(store, None), artifact_table(store, "evaluation"), model_table(store)
    assert set(read) == {"report"}
    for one, other in zip(first, second, strict=True):
        pd.testing.assert_frame_equal(one, other)
    assert find(store, "seed-2", "evaluation") == evaluations[2]
    assert list(second[2]["success_rate"]) == [0.0, 0.1, 0.2]
    assert set(second[2]["observes"]) == {"state"}


def test_a_damaged_artifact_is_logged_and_left_out(tmp_path, caplog):
    store = ArtifactStore(tmp_path)
    refs = []
    for stage in ("ingest", "augment"):
        with store.create(Recipe(stage, "episodes")) as draft:
            pass
        refs.append(draft.ref)
    (tmp_path / str(refs[0]) / MANIFEST_NAME).write_text("nonsense")
    assert list(artifact_table(store, "episodes").index) == [refs[1].id]
    assert f"{refs[0]} is damaged" in caplog.text


def test_episodes_are_taken_by_number_and_by_id(tmp_path, episode_factory):
    written = [
        episode_factory(5, seed=1, milestones={"placed": 4, "lifted": 2}),
        episode_factory(7, seed=2, outcome=Outcome.TIMEOUT, milestones={"lifted": 3}),
    ]
    write_episodes(tmp_path, written, {})
    episodes = Episodes(tmp_path)
    first, second = (episode.record.episode_id for episode in written)
    assert episodes[0].record.episode_id == episodes[-2].record.episode_id == episodes[first].record.episode_id == first
    assert [episode.record.episode_id for episode in episodes] == [first, second]
    assert [*episodes.table["length"]] == [5, 7]
    assert [*episodes.table["success"]] == [True, False]
    assert [*episodes.table.columns[-2:]] == ["lifted", "placed"]
    assert episodes.table["placed"].tolist()[0] == 4
    assert episodes.table["placed"].isna().tolist() == [False, True]
    for key, problem in ((2, "none is 2"), ("ab", "holds no episode ab"), (1.5, "none is 1.5"), (True, "none is True")):
        with pytest.raises(ArtifactError, match=problem):
            episodes[key]


def test_no_episodes_make_an_empty_table(tmp_path):
    write_episodes(tmp_path, [], {}, may_be_empty=True)
    assert len(Episodes(tmp_path).table) == 0


def test_steps_of_an_array_stand_side_by_side_and_images_are_left_out(episode_factory):
    episode = episode_factory(6)
    pixels = ArraySpec("front", (4, 5, 3), "uint8", Role.DERIVED)
    episode = Episode(
        episode.record,
        {**episode.steps, "front": np.zeros((6, 4, 5, 3), np.uint8)},
        episode.final,
        episode.schema.extended(pixels),
    )
    table = step_table(episode)
    np.testing.assert_array_equal(table["action"].to_numpy(), episode.steps["action"])
    assert table["reward"].shape == (6, 1)
    assert set(table.columns.get_level_values(0)) == {"proprioception", "part_poses", "action", "reward"}


def test_curves_of_different_steps_share_a_table():
    table = curve_table({"train/loss": ((10, 20), (1.0, 0.5)), "validation/loss": ((20,), (0.7,))})
    assert table.loc[20].to_dict() == {"train/loss": 0.5, "validation/loss": 0.7}
    assert np.isnan(table.loc[10, "validation/loss"])
    assert len(curve_table({})) == 0


def test_every_task_is_listed():
    table = task_table()
    assert table.loc["one_leg", "environment"] == "juicer/OneLeg-v0"
    assert (table["pairs"] >= 1).all()
