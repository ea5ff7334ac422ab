"""Whatever happens to the files of an artifact is noticed when it is opened or verified."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.errors import DamagedArtifact

Make = Callable[..., ArtifactRef]


def clauses(store: ArtifactStore, ref: ArtifactRef) -> list[str]:
    return [str(finding) for finding in store.verify(ref)]


def delete(path: Path) -> None:
    path.unlink()


def empty(path: Path) -> None:
    path.write_bytes(b"")


def truncate(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-1])


def lengthen(path: Path) -> None:
    path.write_bytes(path.read_bytes() + b"\0")


def zero(path: Path) -> None:
    path.write_bytes(bytes(path.stat().st_size))


def flip_first_bit(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[0] ^= 0x80
    path.write_bytes(content)


def flip_last_bit(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[-1] ^= 0x01
    path.write_bytes(content)


def replace_by_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def replace_by_link(path: Path) -> None:
    copy = path.parents[3] / "copy"
    path.rename(copy)
    path.symlink_to(copy)


def hide_in_folder(path: Path) -> None:
    content = path.read_bytes()
    replace_by_folder(path)
    (path / path.name).write_bytes(content)


DAMAGES = (
    delete,
    empty,
    truncate,
    lengthen,
    zero,
    flip_first_bit,
    flip_last_bit,
    replace_by_folder,
    replace_by_link,
    hide_in_folder,
)


@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize("name", ["a.bin", "deep/er/b.bin", "manifest.json"])
def test_every_damage_to_every_file_is_noticed(
    store: ArtifactStore, recipe: Recipe, make: Make, name: str, damage: Callable[[Path], None]
) -> None:
    ref = make(store, recipe)
    folder = store.open(ref)
    damage(folder / name)
    if name == "manifest.json" and damage is replace_by_link:
        # The text behind the link is the true one.
        assert store.verify(ref) == []
        return
    assert name in clauses(store, ref)[0]
    with pytest.raises(DamagedArtifact, match=name):
        store.open(ref)
    # Damage is not absence: recomputing is the user's decision.
    assert store.find(recipe) == ref


@pytest.mark.parametrize("name", ["extra", "deep/extra", ".hidden", "deep/manifest.json"])
def test_a_file_that_does_not_belong_is_noticed(store: ArtifactStore, recipe: Recipe, make: Make, name: str) -> None:
    ref = make(store, recipe)
    (store.open(ref) / name).write_bytes(b"")
    assert clauses(store, ref) == [f"file '{name}' does not belong to it"]


def test_a_link_to_a_folder_is_noticed(store: ArtifactStore, recipe: Recipe, make: Make, tmp_path: Path) -> None:
    ref = make(store, recipe)
    (store.open(ref) / "link").symlink_to(tmp_path)
    assert clauses(store, ref) == ["file 'link' does not belong to it"]


def test_verify_names_every_problem(store: ArtifactStore, recipe: Recipe, make: Make) -> None:
    ref = make(store, recipe)
    folder = store.open(ref)
    delete(folder / "a.bin")
    zero(folder / "deep/er/b.bin")
    (folder / "extra").write_bytes(b"")
    problems = clauses(store, ref)
    assert len(problems) == 3
    assert all(name in problem for name, problem in zip(("a.bin", "b.bin", "extra"), problems, strict=True))


def test_the_folder_of_another_artifact_is_noticed(store: ArtifactStore, recipe: Recipe, make: Make) -> None:
    ref = make(store, recipe)
    other = make(store, replace(recipe, code="other"))
    shutil.rmtree(store.cache / str(ref))
    shutil.copytree(store.cache / str(other), store.cache / str(ref))
    assert clauses(store, ref) == [f"file 'manifest.json' is that of {other}"]


def test_an_artifact_that_lost_everything_but_its_folder_is_damaged(
    store: ArtifactStore, recipe: Recipe, make: Make
) -> None:
    ref = make(store, recipe)
    folder = store.open(ref)
    shutil.rmtree(folder)
    folder.mkdir()
    assert clauses(store, ref) == ["file 'manifest.json' is missing"]
    store.set_aside(ref)
    assert make(store, recipe) == ref
