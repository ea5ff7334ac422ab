"""What is not juicer's is left alone, and nothing is deleted that could not be made again at once."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from juicer.artifacts.backend import next_room
from juicer.artifacts.findings import Nature
from juicer.artifacts.local import LocalBackend
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.errors import ArtifactNotFound, DamagedArtifact, StoreNotWritable, StrayFile

Make = Callable[..., ArtifactRef]
Fail = Callable[..., None]
Litter = Callable[[ArtifactStore], list[str]]

NAMES = [
    "notes",
    ".ipynb_checkpoints",
    ".DS_Store",
    "0123456789abcdef.before",
    "0123456789ABCDEF",
    "0123456789abcde",
    "0123456789abcdef0",
    "0123456789abcdeg",
    "0123456789abcdef\n",
    " 0123456789abcdef",
    "\u0660\u0661\u0662\u0663\u0664\u0665\u0666\u0667\u0668\u0669abcdef",
]


def folder(path: Path) -> None:
    path.mkdir()
    (path / "mine").write_text("mine")


def file(path: Path) -> None:
    path.write_text("mine")


def dangling_link(path: Path) -> None:
    path.symlink_to("nowhere")


def unspeakable(path: Path) -> None:
    os.mkdir(os.fsencode(path) + b"\xff")  # noqa: PTH102


@pytest.mark.parametrize("thing", [folder, file, dangling_link, unspeakable])
@pytest.mark.parametrize("name", NAMES)
def test_what_is_not_named_like_an_id_is_no_artifact(
    store: ArtifactStore, recipe: Recipe, make: Make, name: str, thing: Callable[[Path], None]
) -> None:
    ref = make(store, recipe)
    path = store.cache / "episodes" / name
    thing(path)
    before = os.listdir(os.fsencode(path.parent))  # noqa: PTH208
    assert store.refs() == [ref]
    assert [manifest.ref for manifest in store.list()] == [ref]
    with pytest.raises(ArtifactNotFound):
        store.resolve(name)
    make(store, replace(recipe, code="next"))
    assert set(before) <= set(os.listdir(os.fsencode(path.parent)))  # noqa: PTH208


def test_a_copied_artifact_beside_the_original_does_not_disturb_it(
    store: ArtifactStore, recipe: Recipe, make: Make
) -> None:
    ref = make(store, recipe)
    original = store.cache / str(ref)
    shutil.copytree(original, original.with_name(f"{ref.id}.before"))
    assert store.refs() == [ref]
    assert store.verify(store.resolve(ref.id[:5])) == []


def test_what_is_named_like_an_id_without_being_one_is_damaged_and_never_deleted(
    store: ArtifactStore, recipe: Recipe, make: Make
) -> None:
    """It stands in the place of an artifact: found out before hours of work, not at their end."""
    place = store.cache / "episodes" / recipe.id
    for number, thing in enumerate((file, dangling_link), start=1):
        place.parent.mkdir(parents=True, exist_ok=True)
        thing(place)
        assert store.find(recipe) == recipe.ref
        with pytest.raises(DamagedArtifact, match=r"something else stands in the place of its folder|is missing"):
            store.open(recipe.ref)
        make(store, recipe, replacing=True)
        assert store.verify(recipe.ref) == []
        aside = Path(store.asides(recipe.ref)[-1])
        assert (aside.name, [path.name for path in aside.iterdir()]) == (str(number), [recipe.id])
        shutil.rmtree(store.cache / str(recipe.ref))


def test_an_artifact_may_lie_elsewhere_behind_a_link_and_what_it_leads_to_stays(
    store: ArtifactStore, recipe: Recipe, make: Make, tmp_path: Path
) -> None:
    ref = make(store, recipe)
    place = store.cache / str(ref)
    place.rename(tmp_path / "elsewhere")
    place.symlink_to(tmp_path / "elsewhere")
    assert store.refs() == [ref]
    assert store.verify(ref) == []
    (tmp_path / "elsewhere" / "a.bin").write_bytes(b"")
    make(store, recipe, replacing=True)
    assert not place.is_symlink()
    assert (tmp_path / "elsewhere" / "a.bin").exists()
    assert store.verify(ref) == []


LITTER = [
    ".DS_Store",
    "Thumbs.db",
    "desktop.ini",
    "._a.bin",
    ".nfs000000000123",
    "a.bin~",
    ".a.bin.swp",
    "#a.bin#",
    "a.bin.bak",
    ".directory",
    ".fuse_hidden0000",
    ".~lock.a.bin#",
    ".ipynb_checkpoints/a-checkpoint.ipynb",
    "@eaDir/a.bin@SynoEAStream",
    "__MACOSX/._a.bin",
    ".Trash-1000/files/a.bin",
]


@pytest.mark.parametrize("below", ["", "deep/er/"])
@pytest.mark.parametrize("name", LITTER)
def test_litter_of_an_operating_system_stops_nothing_and_is_named(
    store: ArtifactStore, recipe: Recipe, make: Make, payload: dict[str, bytes], name: str, below: str
) -> None:
    ref = make(store, recipe)
    path = store.cache / str(ref) / below / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"x")
    opened = store.open(ref)
    assert {name: (opened / name).read_bytes() for name in payload} == payload
    (finding,) = store.verify(ref)
    assert finding.nature is Nature.LITTER
    assert below + name.split("/")[0] in finding.clause
    with store.create(recipe) as draft:
        assert draft.adopted
    assert path.exists()


@pytest.mark.parametrize("name", [".DS_Store", ".nfs0001", "deep/._a.bin", ".ipynb_checkpoints/a"])
def test_litter_that_comes_into_a_draft_is_not_made_part_of_the_artifact(
    store: ArtifactStore, recipe: Recipe, make: Make, name: str
) -> None:
    ref = make(store, recipe, {"a.bin": b"1", name: b"x"})
    assert [entry.path for entry in store.manifest(ref).files] == ["a.bin"]
    # It may go as it came.
    shutil.rmtree(store.cache / str(ref) / name, ignore_errors=True)
    (store.cache / str(ref) / name).unlink(missing_ok=True)
    store.open(ref)


@pytest.mark.parametrize("name", ["0", "zarr.json", "a.bin.old", "copy of a.bin", "notes.txt", ".hidden"])
def test_a_file_that_does_not_belong_is_refused_with_the_file_to_be_removed(
    store: ArtifactStore, recipe: Recipe, make: Make, name: str
) -> None:
    ref = make(store, recipe)
    path = store.cache / str(ref) / "deep" / name
    path.write_bytes(b"")
    with pytest.raises(
        StrayFile, match=rf"whole, but file 'deep/{name}' does not belong to it; remove that from '.*{ref}"
    ):
        store.open(ref)
    path.unlink()
    store.open(ref)


def test_what_a_user_put_into_an_artifact_outlives_its_recomputation(
    store: ArtifactStore, recipe: Recipe, make: Make, caplog: pytest.LogCaptureFixture
) -> None:
    ref = make(store, recipe)
    (store.cache / str(ref) / "notes.txt").write_text("mine")
    make(store, recipe, replacing=True)
    (aside,) = store.asides(ref)
    assert (Path(aside) / "notes.txt").read_text() == "mine"
    assert aside in caplog.text
    assert store.verify(ref) == []


def test_a_whole_artifact_that_is_replaced_leaves_nothing(store: ArtifactStore, recipe: Recipe, make: Make) -> None:
    ref = make(store, recipe)
    (store.cache / str(ref) / ".DS_Store").write_bytes(b"x")
    make(store, recipe, replacing=True)
    assert store.asides(ref) == []


def test_nothing_that_was_set_aside_is_overwritten(store: ArtifactStore, recipe: Recipe, make: Make) -> None:
    for number in range(1, 12):
        make(store, recipe, {"a.bin": str(number).encode()})
        store.set_aside(recipe.ref)
    asides = store.asides(recipe.ref)
    assert [(Path(aside) / "a.bin").read_text() for aside in asides] == [str(number) for number in range(1, 12)]


def test_what_is_set_aside_is_the_last_also_where_earlier_ones_were_removed(
    store: ArtifactStore, recipe: Recipe, make: Make
) -> None:
    for number in range(3):
        make(store, recipe, {"a.bin": str(number).encode()})
        store.set_aside(recipe.ref)
    for removed in store.asides(recipe.ref)[:2]:
        shutil.rmtree(removed)
    make(store, recipe, {"a.bin": b"3"})
    store.set_aside(recipe.ref)
    assert [(Path(aside) / "a.bin").read_text() for aside in store.asides(recipe.ref)] == ["2", "3"]


def test_a_room_is_greater_than_any_other() -> None:
    assert next_room([]) == 1
    assert next_room(["2", "10", "notes"]) == 11


@pytest.mark.parametrize("name", ["notes", "0123456789abcdef.copy", ".hidden"])
@pytest.mark.parametrize("place", ["drafts", "graves", "scratch", "locks"])
def test_what_a_user_keeps_among_the_work_in_progress_is_not_swept_away(
    store: ArtifactStore, recipe: Recipe, make: Make, place: str, name: str
) -> None:
    path = store.cache / ".work" / place / name
    path.mkdir(parents=True)
    (path / "mine").write_text("mine")
    make(store, recipe)
    assert (path / "mine").read_text() == "mine"


@pytest.mark.parametrize("thing", [file, dangling_link, folder])
def test_something_in_the_place_of_a_draft_does_not_stop_the_work(
    store: ArtifactStore, recipe: Recipe, make: Make, thing: Callable[[Path], None]
) -> None:
    place = store.cache / ".work" / "drafts" / recipe.id
    place.parent.mkdir(parents=True)
    thing(place)
    assert store.verify(make(store, recipe)) == []


def test_a_folder_in_the_place_of_a_lock_is_named(store: ArtifactStore, recipe: Recipe, make: Make) -> None:
    (store.cache / ".work" / "locks" / f"{recipe.id}.lock" / "mine").mkdir(parents=True)
    with pytest.raises(StoreNotWritable, match=r"\.lock': a folder stands where a file is needed; move it away"):
        make(store, recipe)


def test_an_artifact_whose_successor_was_never_published_comes_back(
    store: ArtifactStore, recipe: Recipe, make: Make, litter: Litter
) -> None:
    ref = make(store, recipe)
    grave = LocalBackend(store.cache).work.grave(ref)
    for revive in (lambda: make(store, replace(recipe, code="next")), lambda: None):
        grave.parent.mkdir(parents=True, exist_ok=True)
        (store.cache / str(ref)).rename(grave)
        assert store.find(recipe) is None
        revive()
        with store.create(recipe) as draft:
            assert draft.adopted
        assert store.verify(ref) == []
        assert litter(store) == []


def test_scratch_of_an_attempt_to_replace_an_artifact_outlives_other_work(
    store: ArtifactStore, recipe: Recipe, make: Make, fail: Fail, litter: Litter
) -> None:
    ref = make(store, recipe)
    # Told apart by the times of the file system, which may be coarse.
    an_hour_ago = time.time() - 3600
    os.utime(store.cache / str(ref) / "manifest.json", (an_hour_ago, an_hour_ago))
    with pytest.raises(KeyboardInterrupt):
        fail(store, recipe, KeyboardInterrupt(), replacing=True)
    make(store, replace(recipe, code="next"))
    assert f"scratch/{ref.id}/step-100" in litter(store)
