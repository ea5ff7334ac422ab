"""What is damaged is made again from what it was made from, or it is said why not."""

from __future__ import annotations

import errno
from dataclasses import replace
from pathlib import Path

import pytest

from flows.repair import rebuild_call, repair
from juicer.artifacts.store import ArtifactStore
from juicer.episode import Source
from juicer.errors import ArtifactError, ArtifactNotFound, UnreadableArtifact
from juicer.storage.episodes import write_episodes
from stages.select import SelectConfig, select
from stages.session import Session


@pytest.fixture
def session(tmp_path):
    return Session(ArtifactStore(tmp_path / "store"))


@pytest.fixture
def selection(session, episode_factory):
    """A selection, and the episodes it was made from."""
    call = select.prepare(episodes=_rollouts(session, episode_factory), config=SelectConfig())
    return call.execute(session).ref


def _rollouts(session, episode_factory):
    from juicer.artifacts.recipe import Recipe

    recipe = Recipe("collect", "episodes", config={"odd": True})
    with session.store.create(recipe) as draft:
        write_episodes(draft.path, [episode_factory(5, source=Source.ROLLOUT)], {})
    return recipe.ref


def damage(store, ref, name):
    path = store.open(ref) / name
    path.write_bytes(path.read_bytes()[:-1])
    return path


def test_damaged_artifact_is_made_again_byte_for_byte(session, selection):
    whole = session.store.manifest(selection).files
    damage(session.store, selection, "selection.parquet")
    assert list(repair(session, selection)) == [selection]
    assert session.store.manifest(selection).files == whole
    assert list(repair(session, selection)) == []


def test_artifact_whose_origin_is_gone_is_left_with_an_explanation(session, selection):
    (parent,) = session.store.manifest(selection).recipe.parents
    session.store.discard(parent)
    damage(session.store, selection, "selection.parquet")
    with pytest.raises(ArtifactNotFound, match=rf"was made from {parent}, which is gone"):
        list(repair(session, selection))


def test_unreadable_manifest_leaves_nothing_to_repair_from(session, selection):
    damage(session.store, selection, "manifest.json")
    with pytest.raises(ArtifactError, match="so it was discarded; run the flow that made it again"):
        list(repair(session, selection))
    assert selection not in session.store.refs()


def test_manifest_that_the_disk_refuses_to_read_is_no_reason_to_discard(session, selection, monkeypatch):
    def refuse(path):
        raise PermissionError(errno.EACCES, "Permission denied", str(path))

    with monkeypatch.context() as patched:
        patched.setattr(Path, "read_bytes", refuse)
        with pytest.raises(UnreadableArtifact, match=r"may be whole, but .*\(Permission denied\); see to its"):
            list(repair(session, selection))
        assert session.store.list() == []
    assert session.store.verify(selection) == []


def test_changed_code_is_named_as_the_reason_why_not(session, selection):
    recipe = session.store.manifest(selection).recipe
    modules = {**recipe.modules, "stages.select": "another version"}
    with pytest.raises(ArtifactError, match=r"cannot be made again as it was: code of 'stages\.select' changed"):
        rebuild_call(replace(recipe, code="another version", modules=modules), None)


def test_files_from_outside_are_asked_for(session, selection, tmp_path):
    recipe = session.store.manifest(selection).recipe
    with pytest.raises(ArtifactError, match=r"made from the file 'a\.npz'; say with --files where that is"):
        rebuild_call(
            replace(recipe, stage="ingest", config={"task": "one_leg"}, inputs={}, files={"files/a.npz": "00"}), None
        )
