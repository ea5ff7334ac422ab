"""A disk that refuses a write gives one clear sentence, and no half artifact."""

from __future__ import annotations

import errno
import os
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.errors import StoreNotWritable

Make = Callable[..., ArtifactRef]
Fail = Callable[[ArtifactStore, Recipe, BaseException], None]
Litter = Callable[[ArtifactStore], list[str]]

ERRORS = {
    errno.ENOSPC: "disk is full",
    errno.EDQUOT: "quota",
    errno.EROFS: "read-only",
    errno.EIO: "input/output error",
    errno.EACCES: "permission is denied",
    errno.EPERM: "permission is denied",
}


def failing(number: int) -> Callable[..., None]:
    """Stands in for a system call: root, which may run the tests, is refused nothing."""

    def fail(path: object, *arguments: object, **options: object) -> None:
        raise OSError(number, os.strerror(number), str(path))

    return fail


@pytest.mark.parametrize("number", ERRORS)
@pytest.mark.parametrize("call", ["mkdir", "rename", "write_text"])
def test_a_refused_call_becomes_one_sentence(
    store: ArtifactStore, recipe: Recipe, make: Make, monkeypatch: pytest.MonkeyPatch, call: str, number: int
) -> None:
    with monkeypatch.context() as patched:
        patched.setattr(Path, call, failing(number))
        with pytest.raises(StoreNotWritable, match=ERRORS[number]) as caught:
            make(store, recipe, {})
    assert str(store.cache) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert store.find(recipe) is None
    assert make(store, recipe) == recipe.ref


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EIO])
def test_a_failed_fsync_commits_nothing(
    store: ArtifactStore,
    recipe: Recipe,
    make: Make,
    litter: Litter,
    monkeypatch: pytest.MonkeyPatch,
    number: int,
) -> None:
    with monkeypatch.context() as patched:
        patched.setattr(os, "fsync", failing(number))
        with pytest.raises(StoreNotWritable, match=ERRORS[number]):
            make(store, recipe)
    assert store.find(recipe) is None
    assert litter(store) == []


def test_a_full_disk_in_the_block_commits_nothing_and_keeps_the_scratch(
    store: ArtifactStore, recipe: Recipe, fail: Fail
) -> None:
    with pytest.raises(StoreNotWritable, match="disk is full"):
        fail(store, recipe, OSError(errno.ENOSPC, "No space left on device"))
    assert store.find(recipe) is None
    with store.create(recipe) as draft:
        assert list(draft.path.iterdir()) == []
        assert (draft.scratch / "step-100").exists()


def test_files_elsewhere_that_cannot_be_read_are_not_the_stores_business(
    store: ArtifactStore, recipe: Recipe, fail: Fail
) -> None:
    with pytest.raises(PermissionError):
        fail(store, recipe, PermissionError(errno.EACCES, "Permission denied", "/somewhere/else"))


def test_a_store_in_the_place_of_a_file_is_refused(recipe: Recipe, make: Make, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for place in (tmp_path / "file", tmp_path / "file" / "deeper"):
        with pytest.raises(StoreNotWritable, match="a file stands where a folder is needed"):
            make(ArtifactStore(place), recipe)


def test_a_store_below_a_forbidden_folder_is_refused(
    recipe: Recipe, make: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    forbidden = tmp_path / "forbidden"

    def mkdir(path: Path, *arguments: object, **options: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied", str(forbidden))

    monkeypatch.setattr(Path, "mkdir", mkdir)
    with pytest.raises(StoreNotWritable, match="permission is denied"):
        make(ArtifactStore(forbidden / "store"), recipe)


def test_a_store_that_may_only_be_read_can_be_read(
    store: ArtifactStore, recipe: Recipe, make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    ref = make(store, recipe)
    for call in ("mkdir", "rename", "write_text", "write_bytes", "unlink"):
        monkeypatch.setattr(Path, call, failing(errno.EROFS))
    assert store.find(recipe) == ref
    assert store.verify(ref) == []
    assert store.open(store.resolve(ref.id)).is_dir()


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A real file system with one megabyte of room."""
    place = tmp_path / "small"
    place.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(place)], capture_output=True)
    if mounted.returncode:
        pytest.skip("this user may not mount a file system")
    yield place
    subprocess.run(["umount", str(place)], check=True)


def test_a_disk_that_is_really_full_commits_nothing_and_recovers(
    recipe: Recipe, make: Make, small_disk: Path, litter: Litter
) -> None:
    store = ArtifactStore(small_disk / "store")
    with pytest.raises(StoreNotWritable, match="disk is full"):
        make(store, recipe, {"big.bin": bytes(2**21)})
    assert store.find(recipe) is None
    assert litter(store) == []
    assert make(store, recipe) == recipe.ref
