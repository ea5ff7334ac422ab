"""What is damaged is made again from what it was made from, or it is said why not."""

from __future__ import annotations

import errno
import json
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest

from flows.running.repair import rebuild_call, repair
from juicer.artifacts import local
from juicer.artifacts.store import ArtifactStore
from juicer.episode import Source
from juicer.errors import ArtifactError, ArtifactNotFound, StrayFile, UnreadableArtifact
from juicer.storage.episodes import write_episodes
from juicer.training.config import TrainingConfig
from juicer.training.mixing import DatasetConfig
from stages.dataset import dataset
from stages.runtime.execution import execute, perform_here
from stages.runtime.session import Session
from stages.select import SelectConfig, select
from stages.train import TrainConfig, train


@pytest.fixture
def session(tmp_path):
    return Session(ArtifactStore(tmp_path / "store"), perform_here)


@pytest.fixture
def selection(session, episode_factory):
    """A selection, and the episodes it was made from."""
    call = select.prepare(session, episodes=_rollouts(session, episode_factory), config=SelectConfig())
    return execute(call, session).ref


def _rollouts(session, episode_factory):
    from juicer.artifacts.recipe import Recipe

    recipe = Recipe("collect", "episodes", config={"odd": True})
    with session.store.create(recipe) as draft:
        write_episodes(draft.path, [episode_factory(5, source=Source.ROLLOUT)], {})
    return recipe.ref


def damage(store, ref, name):
    path = store.open(ref) / name
    # A manifest that lost no more than its last letter could be restored.
    path.write_bytes(path.read_bytes()[: -9 if name == "manifest.json" else -1])
    return path


def contents(folder):
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_damaged_artifact_is_made_again_byte_for_byte(session, selection):
    whole = session.store.manifest(selection).files
    damage(session.store, selection, "selection.parquet")
    (repaired,) = repair(session, selection)
    assert repaired.ref == selection
    assert repaired.recomputed
    assert session.store.manifest(selection).files == whole
    assert (Path(repaired.aside) / "selection.parquet").stat().st_size == whole[0].bytes - 1
    assert list(repair(session, selection)) == []


def test_episodes_behind_a_dataset_are_mended_before_what_was_learned_from_them(session, selection):
    (rollouts,) = session.store.manifest(selection).recipe.parents
    mixed = dataset(session, episodes=(rollouts,), selections=(selection,), config=DatasetConfig())
    config = TrainConfig(
        policy={"horizons": {"pred": 2, "action": 1}, "head": {"kind": "mlp", "width": 8, "blocks": 1}},
        training=TrainingConfig(steps=2, warmup_steps=1, batch_size=2, validation_fraction=0),
    )
    checkpoint = train(session, dataset=mixed, config=config)
    damage(session.store, checkpoint, "curves.json")
    damage(session.store, selection, "selection.parquet")
    assert [each.ref for each in repair(session, checkpoint)] == [selection, checkpoint]
    damage(session.store, checkpoint, "curves.json")
    damage(session.store, mixed, "dataset.parquet")
    assert [each.ref for each in repair(session, checkpoint)] == [mixed, checkpoint]
    damage(session.store, checkpoint, "curves.json")
    session.store.set_aside(rollouts)
    with pytest.raises(ArtifactNotFound, match=rf"was made from {rollouts}, which is gone"):
        list(repair(session, checkpoint))


def test_artifact_whose_origin_is_gone_is_left_with_an_explanation(session, selection):
    (parent,) = session.store.manifest(selection).recipe.parents
    session.store.set_aside(parent)
    damage(session.store, selection, "selection.parquet")
    with pytest.raises(ArtifactNotFound, match=rf"was made from {parent}, which is gone"):
        list(repair(session, selection))


def test_artifact_with_an_unusable_manifest_is_moved_aside_whole(session, selection):
    path = damage(session.store, selection, "manifest.json")
    before = contents(path.parent)
    with pytest.raises(ArtifactError, match=r"nothing was deleted: all of it is now in '.*'; run the flow that made"):
        list(repair(session, selection))
    assert selection not in session.store.refs()
    (aside,) = session.store.asides(selection)
    assert contents(Path(aside)) == before


def test_nothing_that_was_set_aside_is_ever_overwritten(session, selection):
    recipe = session.store.manifest(selection).recipe
    for _ in range(3):
        if session.store.find(recipe) is None:
            with session.store.create(recipe) as draft:
                (draft.path / "selection.parquet").write_bytes(b"rows")
        damage(session.store, selection, "manifest.json")
        with pytest.raises(ArtifactError, match="nothing was deleted"):
            list(repair(session, selection))
    assert [Path(aside).name for aside in session.store.asides(selection)] == ["1", "2", "3"]


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text + b"\n",
        lambda text: text + b"# checked\n",
        lambda text: text.replace(b"\n", b"\r\n"),
        lambda text: b"\xef\xbb\xbf" + text,
        lambda text: text.rstrip(),
        lambda text: json.dumps(json.loads(text)).encode(),
    ],
    ids=["line", "note", "windows", "mark", "stripped", "reformatted"],
)
def test_manifest_whose_content_is_whole_is_restored_without_computing(session, selection, change):
    path = session.store.open(selection) / "manifest.json"
    original = path.read_bytes()
    path.write_bytes(change(original))
    assert session.store.verify(selection)
    session = replace(session, performer=None)
    (repaired,) = repair(session, selection)
    assert (repaired.ref, repaired.recomputed) == (selection, False)
    assert path.read_bytes() == original
    assert session.store.verify(selection) == []
    assert (Path(repaired.aside) / "manifest.json").read_bytes() == change(original)


@pytest.mark.parametrize("name", [".DS_Store", "._selection.parquet", "Thumbs.db", "selection.parquet~"])
def test_litter_of_an_operating_system_is_no_reason_to_repair(session, selection, name):
    (session.store.open(selection) / name).write_bytes(b"x")
    assert list(repair(replace(session, performer=None), selection)) == []
    assert (session.store.open(selection) / name).read_bytes() == b"x"


def test_file_that_does_not_belong_is_named_and_nothing_is_recomputed(session, selection):
    stray = session.store.open(selection) / "notes.txt"
    stray.write_text("mine")
    with pytest.raises(StrayFile, match=r"nothing in .* needs to be recomputed, but file 'notes.txt' does not belong"):
        list(repair(replace(session, performer=None), selection))
    with pytest.raises(StrayFile, match=r"is whole, but file 'notes\.txt' does not belong to it; remove that from"):
        session.store.open(selection)
    assert stray.read_text() == "mine"


def test_what_a_user_left_in_a_damaged_artifact_outlives_its_repair(session, selection):
    path = damage(session.store, selection, "selection.parquet")
    (path.parent / "notes.txt").write_text("mine")
    (repaired,) = repair(session, selection)
    assert (Path(repaired.aside) / "notes.txt").read_text() == "mine"
    assert session.store.verify(selection) == []


def test_whole_artifact_needs_nothing_that_it_was_made_from(session, selection):
    (parent,) = session.store.manifest(selection).recipe.parents
    session.store.set_aside(parent)
    assert list(repair(session, selection)) == []


def test_damaged_ancestor_is_named_and_not_touched(session, selection):
    (parent,) = session.store.manifest(selection).recipe.parents
    path = damage(session.store, parent, "manifest.json")
    before = contents(path.parent)
    damage(session.store, selection, "selection.parquet")
    with pytest.raises(ArtifactError, match=rf"a repair needs {parent}, but .*juicer repair {parent.id}"):
        list(repair(session, selection))
    assert contents(path.parent) == before


def test_of_two_repairs_at_once_one_computes_and_the_other_adopts(session, selection):
    damage(session.store, selection, "selection.parquet")
    computed = []
    together = threading.Barrier(2)

    def perform(call, session):
        together.wait()
        finished = execute(call, session)
        computed.append(not finished.reused)
        return finished.ref

    with ThreadPoolExecutor(2) as pool:
        list(pool.map(lambda _: list(repair(replace(session, performer=perform), selection)), range(2)))
    assert sorted(computed) == [False, True]
    assert session.store.verify(selection) == []


def test_repair_that_does_not_last_ends(session, selection):
    damage(session.store, selection, "selection.parquet")
    with pytest.raises(ArtifactError, match="made again and is damaged again; check the disk"):
        list(repair(replace(session, performer=lambda call, session: call.recipe.ref), selection))


def test_manifest_that_the_disk_refuses_to_read_is_no_reason_to_discard(session, selection, monkeypatch):
    def refuse(path, most_bytes):
        raise PermissionError(errno.EACCES, "Permission denied", str(path))

    with monkeypatch.context() as patched:
        patched.setattr(local, "read_bounded", refuse)
        with pytest.raises(UnreadableArtifact, match=r"may be whole, but .*\(Permission denied\); see to its"):
            list(repair(session, selection))
        assert session.store.list() == []
    assert session.store.verify(selection) == []


def test_changed_code_is_named_as_the_reason_why_not(session, selection):
    recipe = session.store.manifest(selection).recipe
    modules = {**recipe.modules, "stages.select": "another version"}
    with pytest.raises(ArtifactError, match=r"cannot be made again as it was: code of 'stages\.select' changed"):
        rebuild_call(replace(recipe, code="another version", modules=modules), None, session)


def test_files_from_outside_are_asked_for(session, selection, tmp_path):
    recipe = session.store.manifest(selection).recipe
    with pytest.raises(ArtifactError, match=r"made from the file 'a\.npz'; say with --files where that is"):
        rebuild_call(
            replace(recipe, stage="ingest", config={"task": "one_leg"}, inputs={}, files={"files/a.npz": "00"}),
            None,
            session,
        )
