"""What cannot be looked at is never taken for what is not there, nor for damage."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.errors import ArtifactNotFound, StoreNotWritable, UnreadableArtifact

Make = Callable[..., ArtifactRef]
AsNobody = Callable[[Callable[[], Any]], Any]


@pytest.fixture
def store(open_place: Path) -> ArtifactStore:
    return ArtifactStore(open_place / "store")


@pytest.fixture
def selection(store: ArtifactStore, recipe: Recipe, make: Make) -> ArtifactRef:
    """A selection, beside an artifact made from ``recipe``."""
    make(store, recipe)
    return make(store, replace(recipe, kind="selection"))


def forbid(path: Path, mode: int = 0) -> None:
    path.chmod(mode)


@pytest.mark.parametrize("mode", [0o000, 0o111, 0o444])
def test_a_kind_that_cannot_be_read_is_named_and_the_others_are_found(
    store: ArtifactStore, recipe: Recipe, selection: ArtifactRef, as_nobody: AsNobody, mode: int
) -> None:
    forbid(store.cache / "episodes", mode)
    listing = as_nobody(store.survey)
    assert selection in listing.refs
    if mode == 0o444:
        # Names can be read, but nothing below them.
        assert recipe.ref in listing.refs
        with pytest.raises(UnreadableArtifact, match=r"may be whole, but .*\(Permission denied\)"):
            as_nobody(lambda: store.open(recipe.ref))
    else:
        (clause,) = listing.unseen
        assert clause == f"folder '{store.cache / 'episodes'}' cannot be read (Permission denied)"
    assert [manifest.ref for manifest in as_nobody(store.list)] in ([selection], [recipe.ref, selection])


@pytest.mark.parametrize("place", ["store", "."])
def test_a_store_that_cannot_be_entered_is_named_once(
    open_place: Path, store: ArtifactStore, recipe: Recipe, selection: ArtifactRef, as_nobody: AsNobody, place: str
) -> None:
    forbid(open_place / place)
    listing = as_nobody(store.survey)
    assert listing.refs == ()
    assert listing.unseen == (f"folder '{(open_place / place).resolve()}' cannot be read (Permission denied)",)
    with pytest.raises(UnreadableArtifact, match=r"may be whole, but folder .* cannot be read"):
        as_nobody(lambda: store.find(recipe))


def test_what_a_run_needs_is_not_made_again_because_it_cannot_be_looked_for(
    store: ArtifactStore, recipe: Recipe, selection: ArtifactRef, as_nobody: AsNobody
) -> None:
    forbid(store.cache / "episodes")

    def run() -> None:
        with store.create(recipe):
            pytest.fail("the block must not run")

    for call in (lambda: store.find(recipe), lambda: store.exists(recipe.ref), lambda: store.lineage(recipe.ref)):
        with pytest.raises(UnreadableArtifact, match=r"Permission denied\); see to its permissions"):
            as_nobody(call)
    with pytest.raises((UnreadableArtifact, StoreNotWritable), match=r"[Pp]ermission"):
        as_nobody(run)


def test_a_name_that_may_belong_to_something_unseen_is_not_resolved(
    store: ArtifactStore, recipe: Recipe, selection: ArtifactRef, as_nobody: AsNobody
) -> None:
    forbid(store.cache / "episodes")
    for text in (recipe.id, recipe.id[:5], selection.id[:5], f"episodes/{recipe.id[:5]}"):
        with pytest.raises(UnreadableArtifact, match=r"cannot be told which artifact .*Permission denied"):
            as_nobody(lambda text=text: store.resolve(text))
    for text in (selection.id, f"selection/{selection.id[:5]}", str(selection)):
        assert as_nobody(lambda text=text: store.resolve(text)) == selection


def test_an_artifact_that_cannot_be_entered_is_not_called_damaged(
    store: ArtifactStore, recipe: Recipe, selection: ArtifactRef, as_nobody: AsNobody
) -> None:
    forbid(store.cache / str(recipe.ref))
    for call in (store.open, store.manifest, store.lineage):
        with pytest.raises(UnreadableArtifact, match=r"may be whole, but file 'manifest\.json' cannot be read"):
            as_nobody(lambda call=call: call(recipe.ref))
    assert set(as_nobody(store.refs)) == {recipe.ref, selection}


def test_a_folder_within_an_artifact_that_hides_its_files_is_named(
    store: ArtifactStore, recipe: Recipe, selection: ArtifactRef, as_nobody: AsNobody
) -> None:
    forbid(store.cache / str(recipe.ref) / "deep", 0o111)
    with pytest.raises(UnreadableArtifact, match=r"folder 'deep' cannot be read \(Permission denied\)"):
        as_nobody(lambda: store.open(recipe.ref))


@pytest.mark.parametrize("broken", ["file", "dangling link", "loop"])
@pytest.mark.parametrize("place", ["store", "store/episodes"])
def test_what_stands_in_the_place_of_a_folder_is_named(
    open_place: Path, store: ArtifactStore, recipe: Recipe, place: str, broken: str
) -> None:
    path = open_place / place
    path.parent.mkdir(exist_ok=True)
    if broken == "file":
        path.write_text("mine")
    else:
        path.symlink_to(path if broken == "loop" else "nowhere")
    listing = store.survey()
    assert listing.refs == ()
    assert f"folder '{path}' cannot be read" in listing.unseen[0]
    assert len(listing.unseen) == 1
    with pytest.raises(UnreadableArtifact, match="cannot be told which artifact"):
        store.resolve("0123")


def test_a_store_that_does_not_exist_holds_nothing(open_place: Path, store: ArtifactStore) -> None:
    assert not store.is_there()
    assert store.survey().unseen == ()
    with pytest.raises(ArtifactNotFound, match="no artifact answers"):
        store.resolve("0123")
    assert not store.cache.exists()


def test_a_store_that_may_only_be_read_is_read_without_any_attempt_to_write(
    store: ArtifactStore, recipe: Recipe, selection: ArtifactRef, as_nobody: AsNobody
) -> None:
    before = {path: path.lstat().st_mtime_ns for path in store.cache.rglob("*")}
    assert as_nobody(lambda: store.verify(recipe.ref)) == []
    assert as_nobody(lambda: store.open(recipe.ref).is_dir())
    assert as_nobody(lambda: store.resolve(selection.id[:8])) == selection
    assert as_nobody(lambda: store.lineage(selection)) == []
    assert len(as_nobody(store.list)) == 2
    assert {path: path.lstat().st_mtime_ns for path in store.cache.rglob("*")} == before


@pytest.mark.parametrize("place", ["episodes", ".work/locks", ".work/drafts", ".work/scratch"])
def test_a_folder_that_may_not_be_written_is_named_before_the_work(
    store: ArtifactStore, recipe: Recipe, selection: ArtifactRef, as_nobody: AsNobody, place: str
) -> None:
    for path in (store.cache, *store.cache.rglob("*")):
        path.chmod(0o777)
    forbid(store.cache / place, 0o555)

    def run() -> None:
        with store.create(replace(recipe, code="next")):
            pytest.fail("the block must not run")

    expected = rf"cannot be written: permission is denied: user '\w+' may not write in '{store.cache / place}'; change"
    with pytest.raises(StoreNotWritable, match=expected):
        as_nobody(run)


@pytest.mark.parametrize("place", [".", "store"])
def test_a_data_folder_that_may_only_be_read_is_named_with_the_right_that_is_missing(
    open_place: Path, store: ArtifactStore, recipe: Recipe, make: Make, as_nobody: AsNobody, place: str
) -> None:
    (open_place / place).mkdir(exist_ok=True)
    forbid(open_place / place, 0o555)
    folder = (open_place / place).resolve()
    with pytest.raises(StoreNotWritable, match=rf"denied: user '\w+' may not write in '{folder}'; change its owner"):
        as_nobody(lambda: make(store, recipe))


def test_leftovers_that_cannot_be_cleared_away_do_not_stop_the_work(
    store: ArtifactStore, recipe: Recipe, make: Make, selection: ArtifactRef, as_nobody: AsNobody
) -> None:
    graves = store.cache / ".work" / "graves"
    graves.mkdir()
    for path in (store.cache, *store.cache.rglob("*")):
        path.chmod(0o777)
    forbid(graves)
    new = replace(recipe, code="next")
    as_nobody(lambda: make(store, new))
    assert store.verify(new.ref) == []


def test_what_cannot_be_looked_at_is_logged_where_the_rest_is_used(
    store: ArtifactStore, recipe: Recipe, make: Make, caplog: pytest.LogCaptureFixture
) -> None:
    ref = make(store, recipe)
    (store.cache / "report").write_text("a file")
    with caplog.at_level(logging.WARNING):
        assert [manifest.ref for manifest in store.list()] == [ref]
    assert f"there may be more artifacts: folder '{store.cache / 'report'}' cannot be read" in caplog.text
