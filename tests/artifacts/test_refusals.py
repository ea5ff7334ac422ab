"""A disk that refuses a write gives one clear sentence, and no half artifact."""

from __future__ import annotations

import errno
import os
import resource
import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
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
    errno.EFBIG: "a file became larger than this system allows",
    errno.ENOLCK: "offers no locks",
    errno.EBUSY: "device or resource busy",
    errno.EXDEV: "lies on another file system",
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


def safetensors_of_torch(folder: Path) -> None:
    import torch
    from safetensors.torch import save_file

    from juicer.policy.refusals import refusals_as_os_errors

    with refusals_as_os_errors(folder / "weights.safetensors"):
        save_file({"weights": torch.zeros(2**20)}, folder / "weights.safetensors")


def training_state(folder: Path) -> None:
    import torch

    from juicer.training.state import TrainingState, save_state

    save_state(folder, TrainingState("id", 1, {"weights": torch.zeros(2**20)}))


def replayed_demonstrations(folder: Path) -> None:
    from safetensors.numpy import save_file

    from juicer.policy.refusals import refusals_as_os_errors
    from juicer.policy.replay import REPLAY_FILE

    with refusals_as_os_errors(folder / REPLAY_FILE):
        save_file({"actions": np.zeros(2**20)}, folder / REPLAY_FILE)


def zarr_and_parquet(folder: Path) -> None:
    from juicer.episode import SIMULATOR, Episode, EpisodeRecord, Outcome, Source
    from juicer.storage.episodes import write_episodes

    rng = np.random.default_rng(0)
    sizes = {"part_poses": (14,), "sim_state": (200,)}
    steps = {
        spec.name: rng.normal(size=(2500, *sizes.get(spec.name, spec.shape))).astype(spec.dtype) for spec in SIMULATOR
    }
    record = EpisodeRecord(
        source=Source.TELEOP, task="one_leg", randomness="low", seed=1, parts_assembled=1, outcome=Outcome.SUCCESS
    )
    episode = Episode(record, steps, {name: steps[name][-1] for name in SIMULATOR.ends})
    write_episodes(folder, [episode], {})


def parquet(folder: Path) -> None:
    from juicer.storage.tables import SelectionRow, write_selection

    rng = np.random.default_rng(0)
    write_selection(folder, [SelectionRow(str(index), True, rng.bytes(20).hex()) for index in range(60_000)])


def compressed_log(folder: Path) -> None:
    np.savez_compressed(folder / "log.npz", noise=np.random.default_rng(0).random(2**18))


def text(folder: Path) -> None:
    (folder / "page.html").write_text("x" * 2**21)


WRITERS = [
    safetensors_of_torch,
    training_state,
    replayed_demonstrations,
    zarr_and_parquet,
    parquet,
    compressed_log,
    text,
]


@pytest.mark.parametrize("write", WRITERS)
def test_whatever_writes_on_a_full_disk_gives_the_same_sentence(
    recipe: Recipe, small_disk: Path, write: Callable[[Path], None]
) -> None:
    store = ArtifactStore(small_disk / "store")
    expected = "cannot be written: the disk is full; free some space"
    for folder in ("path", "scratch"):
        with pytest.raises(StoreNotWritable, match=expected), store.create(recipe) as draft:
            write(getattr(draft, folder))
        assert store.find(recipe) is None


@pytest.mark.parametrize("write", WRITERS)
def test_whatever_writes_beyond_the_users_limit_gives_the_same_sentence(
    open_place: Path, recipe: Recipe, write: Callable[[Path], None], as_nobody: Callable[[Callable[[], Any]], Any]
) -> None:
    store = ArtifactStore(open_place / "store")
    store.cache.mkdir()
    store.cache.chmod(0o777)

    def run() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (2**16, 2**16))
        with store.create(recipe) as draft:
            write(draft.path)

    with pytest.raises(StoreNotWritable, match="a file became larger than this system allows; see `ulimit -f`"):
        as_nobody(run)
    assert store.find(recipe) is None


def test_a_resume_state_that_found_no_room_leaves_the_one_before_and_no_half(small_disk: Path) -> None:
    import torch

    from juicer.training.state import TrainingState, load_state, save_state

    save_state(small_disk, TrainingState("id", 1, {"weights": torch.ones(10)}))
    with pytest.raises(OSError, match="No space left"):
        training_state(small_disk)
    assert [path.name for path in small_disk.iterdir()] == ["training_state.safetensors"]
    state = load_state(small_disk, "id")
    assert state is not None
    assert state.step == 1


def test_a_kind_on_another_disk_is_refused_before_the_work(
    store: ArtifactStore, recipe: Recipe, small_disk: Path
) -> None:
    store.cache.mkdir(parents=True)
    (store.cache / "episodes").symlink_to(small_disk)
    expected = "lies on another file system than the rest of the store; link the whole store there"
    with pytest.raises(StoreNotWritable, match=expected), store.create(recipe):
        pytest.fail("the block must not run")


def test_a_store_that_is_removed_during_the_work_is_named(store: ArtifactStore, recipe: Recipe, tmp_path: Path) -> None:
    def work() -> None:
        with store.create(recipe) as draft:
            store.cache.rename(tmp_path / "gone")
            (draft.path / "a.bin").write_bytes(b"1")

    with pytest.raises(StoreNotWritable, match="was removed while it was in use"):
        work()
