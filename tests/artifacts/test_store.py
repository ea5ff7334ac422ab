"""The artifact store in ordinary times."""

from __future__ import annotations

import errno
import logging
import pickle
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.errors import ArtifactError, ArtifactNotFound, DamagedArtifact, StoreNotWritable, WrongArtifactKind

Make = Callable[..., ArtifactRef]
Fail = Callable[..., None]
Litter = Callable[[ArtifactStore], list[str]]


def variant(recipe: Recipe, number: int, *parents: ArtifactRef, kind: str = "episodes") -> Recipe:
    return replace(recipe, kind=kind, config={"number": number}, inputs={"parents": parents})


def test_an_artifact_is_found_only_after_its_block_has_ended(store: ArtifactStore, recipe: Recipe) -> None:
    assert store.find(recipe) is None
    with store.create(recipe) as draft:
        (draft.path / "a.bin").write_bytes(b"1")
        assert store.find(recipe) is None
        assert store.refs() == []
    assert store.find(recipe) == draft.ref == recipe.ref


def test_an_opened_artifact_holds_what_was_written(
    store: ArtifactStore, recipe: Recipe, make: Make, payload: dict[str, bytes]
) -> None:
    folder = store.open(make(store, recipe), kind="episodes")
    assert {name: (folder / name).read_bytes() for name in payload} == payload


def test_a_commit_leaves_nothing_but_the_artifact(
    store: ArtifactStore, recipe: Recipe, make: Make, litter: Litter
) -> None:
    make(store, recipe)
    assert litter(store) == []


def test_the_manifest_tells_what_was_made_of_what(
    store: ArtifactStore, recipe: Recipe, make: Make, payload: dict[str, bytes]
) -> None:
    manifest = store.manifest(make(store, recipe, episodes=50, rate=0.5))
    assert manifest.recipe == recipe
    assert manifest.summary == {"episodes": 50, "rate": 0.5}
    assert {entry.path: entry.bytes for entry in manifest.files} == {name: len(data) for name, data in payload.items()}
    assert manifest.started <= manifest.finished
    assert manifest.seconds >= 0
    assert manifest.host["python"]


def test_a_second_block_for_one_recipe_is_adopted_and_changes_nothing(
    store: ArtifactStore, recipe: Recipe, make: Make
) -> None:
    before = store.manifest(make(store, recipe))
    with store.create(recipe) as draft:
        assert draft.adopted
        assert draft.ref == recipe.ref
    assert store.manifest(recipe.ref) == before


def test_an_error_in_the_block_leaves_neither_artifact_nor_draft(
    store: ArtifactStore, recipe: Recipe, fail: Fail, litter: Litter
) -> None:
    with pytest.raises(ZeroDivisionError):
        fail(store, recipe, ZeroDivisionError())
    assert store.find(recipe) is None
    assert litter(store) == [f"scratch/{recipe.id}", f"scratch/{recipe.id}/step-100"]


def test_an_error_before_anything_was_worth_keeping_leaves_nothing(
    store: ArtifactStore, recipe: Recipe, litter: Litter
) -> None:
    with pytest.raises(ZeroDivisionError), store.create(recipe):
        raise ZeroDivisionError
    assert litter(store) == []


def test_scratch_outlives_an_error_and_goes_with_the_commit(
    store: ArtifactStore, recipe: Recipe, fail: Fail, litter: Litter
) -> None:
    with pytest.raises(KeyboardInterrupt):
        fail(store, recipe, KeyboardInterrupt())
    with store.create(recipe) as draft:
        assert (draft.scratch / "step-100").read_bytes() == b"resume from here"
        (draft.path / "a.bin").write_bytes(b"1")
    assert litter(store) == []


def test_only_plain_files_can_be_part_of_an_artifact(store: ArtifactStore, recipe: Recipe, tmp_path: Path) -> None:
    with pytest.raises(ArtifactError, match="'link' cannot be part of an artifact"), store.create(recipe) as draft:
        (draft.path / "link").symlink_to(tmp_path)
    assert store.find(recipe) is None


def test_a_store_travels_to_another_process_as_its_address(
    store: ArtifactStore, recipe: Recipe, make: Make, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    make(store, recipe)
    content = pickle.dumps(store)
    assert len(content) < 500
    monkeypatch.chdir(tmp_path)
    assert pickle.loads(content).find(recipe) == recipe.ref


def test_a_relative_store_stays_where_it_was_named(
    recipe: Recipe, make: Make, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    store = ArtifactStore("data")
    make(store, recipe)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert store.find(recipe) is not None
    assert ArtifactStore(f"file://{tmp_path}/data").find(recipe) is not None


@pytest.mark.parametrize("url", ["~/store", "file://~/store"])
def test_a_store_may_be_named_from_the_home_folder(url: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    assert ArtifactStore(url).url == str(tmp_path / "store")


def test_what_was_never_made_is_not_found(store: ArtifactStore, recipe: Recipe) -> None:
    for action in (store.open, store.manifest, store.verify, store.set_aside, store.lineage):
        with pytest.raises(ArtifactNotFound, match="see `juicer ls episodes`"):
            action(recipe.ref)


def test_an_artifact_of_another_kind_is_refused(store: ArtifactStore, recipe: Recipe, make: Make) -> None:
    ref = make(store, recipe)
    with pytest.raises(WrongArtifactKind, match="is of kind 'episodes' but 'checkpoint' is needed"):
        store.open(ref, kind="checkpoint")
    with pytest.raises(WrongArtifactKind, match="'checkpoint' is needed"):
        store.resolve(ref.id, kind="checkpoint")


def test_artifacts_are_listed_oldest_first_and_by_kind(store: ArtifactStore, recipe: Recipe, make: Make) -> None:
    refs = [make(store, variant(recipe, number)) for number in range(3)]
    selection = make(store, variant(recipe, 0, kind="selection"))
    assert [manifest.ref for manifest in store.list()] == [*refs, selection]
    assert [manifest.ref for manifest in store.list("selection")] == [selection]
    assert store.list("report") == []


def test_a_damaged_manifest_does_not_hide_the_others(
    store: ArtifactStore, recipe: Recipe, make: Make, caplog: pytest.LogCaptureFixture
) -> None:
    damaged, whole = make(store, variant(recipe, 0)), make(store, variant(recipe, 1))
    (store.cache / str(damaged) / "manifest.json").write_text("{}")
    with caplog.at_level(logging.WARNING):
        assert [manifest.ref for manifest in store.list()] == [whole]
    assert str(damaged) in caplog.text
    assert set(store.refs()) == {damaged, whole}


def test_an_artifact_answers_to_its_id_and_to_the_beginning_of_it(
    store: ArtifactStore, recipe: Recipe, make: Make
) -> None:
    ref = make(store, recipe)
    for text in (ref.id, ref.id[:6], str(ref), f"episodes/{ref.id[:4]}", f" {ref.id}\n"):
        assert store.resolve(text) == ref
        assert store.resolve(text, kind="episodes") == ref


def test_a_beginning_shared_by_several_is_refused_with_their_names(
    store: ArtifactStore, recipe: Recipe, make: Make
) -> None:
    refs = [make(store, variant(recipe, number)) for number in range(17)]
    initials = [ref.id[0] for ref in refs]
    shared = next(initial for initial in initials if initials.count(initial) > 1)
    with pytest.raises(ArtifactNotFound, match="give more digits"):
        store.resolve(shared)


def test_the_kind_that_is_needed_decides_between_artifacts_with_one_beginning(
    store: ArtifactStore, recipe: Recipe, make: Make
) -> None:
    for number in range(17):
        make(store, variant(recipe, number))
    selection = make(store, variant(recipe, 0, kind="selection"))
    assert store.resolve(selection.id[0], kind="selection") == selection


@pytest.mark.parametrize("text", ["", "zzz", "episodes/", "0123456789abcdef", "../episodes"])
def test_nonsense_resolves_to_nothing(store: ArtifactStore, recipe: Recipe, make: Make, text: str) -> None:
    make(store, recipe)
    with pytest.raises(ArtifactNotFound, match=r"juicer ls|names no kind"):
        store.resolve(text)


def test_lineage_names_every_ancestor_once_and_parents_first(store: ArtifactStore, recipe: Recipe, make: Make) -> None:
    root = make(store, variant(recipe, 0))
    left = make(store, variant(recipe, 1, root))
    right = make(store, variant(recipe, 2, root))
    child = make(store, variant(recipe, 3, right, left, kind="checkpoint"))
    assert store.lineage(child) == [root, right, left]
    assert store.lineage(root) == []


def test_lineage_may_be_longer_than_pythons_stack(store: ArtifactStore, recipe: Recipe, make: Make) -> None:
    made = store.manifest(make(store, recipe, {}))
    refs = [made.ref]
    while len(refs) < sys.getrecursionlimit() + 100:
        # Committed one by one, they would take half a minute.
        manifest = replace(made, recipe=replace(recipe, inputs={"parents": tuple(refs[-2:])}))
        refs.append(manifest.ref)
        (store.cache / str(manifest.ref)).mkdir()
        (store.cache / str(manifest.ref) / "manifest.json").write_text(manifest.to_text())
    assert store.lineage(refs[-1]) == refs[:-1]


def test_a_discarded_ancestor_is_still_named(store: ArtifactStore, recipe: Recipe, make: Make) -> None:
    root = make(store, variant(recipe, 0))
    middle = make(store, variant(recipe, 1, root))
    child = make(store, variant(recipe, 2, middle))
    store.set_aside(middle)
    assert store.lineage(child) == [middle]


def test_a_discarded_artifact_can_be_made_again(
    store: ArtifactStore, recipe: Recipe, make: Make, litter: Litter
) -> None:
    make(store, recipe)
    store.set_aside(recipe.ref)
    assert store.find(recipe) is None
    assert litter(store) == []
    make(store, recipe)
    assert store.verify(recipe.ref) == []


def test_damage_names_the_artifact_the_file_and_the_remedy(store: ArtifactStore, recipe: Recipe, make: Make) -> None:
    ref = make(store, recipe)
    (store.cache / str(ref) / "a.bin").unlink()
    with pytest.raises(DamagedArtifact, match=rf"{ref} is damaged: file 'a.bin' is missing; .*juicer repair {ref.id}"):
        store.open(ref)


def test_a_replaced_artifact_stays_until_its_successor_is_whole(
    store: ArtifactStore, recipe: Recipe, make: Make, fail: Fail, litter: Litter
) -> None:
    ref = make(store, recipe, {"a.bin": b"old"})
    with pytest.raises(KeyboardInterrupt):
        fail(store, recipe, KeyboardInterrupt(), replacing=True)
    assert (store.open(ref) / "a.bin").read_bytes() == b"old"
    with store.create(recipe, replacing=True) as draft:
        assert not draft.adopted
        (draft.path / "b.bin").write_bytes(b"new")
        assert (store.open(ref) / "a.bin").read_bytes() == b"old"
    assert [path.name for path in sorted(store.open(ref).iterdir())] == ["b.bin", "manifest.json"]
    assert litter(store) == []


def test_a_replaced_artifact_comes_back_if_its_successor_cannot_be_published(
    store: ArtifactStore, recipe: Recipe, make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    ref = make(store, recipe, {"a.bin": b"old"})
    original = Path.rename

    def rename(path: Path, target: Path) -> None:
        if path.parent.name == "drafts":
            raise OSError(errno.ENOSPC, "No space left on device", str(path))
        original(path, target)

    with monkeypatch.context() as patched:
        patched.setattr(Path, "rename", rename)
        with pytest.raises(StoreNotWritable, match="disk is full"):
            make(store, recipe, {"a.bin": b"new"}, replacing=True)
    assert (store.open(ref) / "a.bin").read_bytes() == b"old"
