"""Several processes, and threads, that need one id: one computes, the others wait and adopt."""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path

import pytest

from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.artifacts.workspace import Workspace

Make = Callable[..., ArtifactRef]
Litter = Callable[[ArtifactStore], list[str]]

fork = multiprocessing.get_context("fork")


def make_slowly(store: ArtifactStore, recipe: Recipe) -> bool:
    with store.create(recipe) as draft:
        if not draft.adopted:
            (draft.path / "maker").write_text(f"{os.getpid()} {threading.get_ident()}")
            time.sleep(0.3)
            (draft.path / "last").write_text("1")
    return draft.adopted


@pytest.mark.parametrize("workers", [2, 8])
def test_of_several_processes_one_computes_and_the_others_adopt(
    store: ArtifactStore, recipe: Recipe, litter: Litter, workers: int
) -> None:
    with ProcessPoolExecutor(workers, mp_context=fork) as pool:
        adopted = list(pool.map(make_slowly, [store] * workers, [recipe] * workers))
    assert sorted(adopted) == [False] + [True] * (workers - 1)
    assert store.verify(recipe.ref) == []
    assert litter(store) == []


def test_of_several_threads_one_computes_and_the_others_adopt(
    store: ArtifactStore, recipe: Recipe, litter: Litter
) -> None:
    with ThreadPoolExecutor(4) as pool:
        adopted = list(pool.map(make_slowly, [store] * 4, [recipe] * 4))
    assert sorted(adopted) == [False, True, True, True]
    assert litter(store) == []


def test_whoever_waits_says_so(store: ArtifactStore, recipe: Recipe, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO), ThreadPoolExecutor(2) as pool:
        list(pool.map(make_slowly, [store] * 2, [recipe] * 2))
    assert f"waiting for another process that works on {recipe.id}" in caplog.text


def test_a_waiter_takes_over_when_the_computing_process_is_killed(store: ArtifactStore, recipe: Recipe) -> None:
    owner = fork.Process(target=_hang, args=(store, recipe))
    owner.start()
    draft = store.cache / ".work" / "drafts" / recipe.id / "begun"
    while not draft.exists():
        time.sleep(0.01)
    threading.Timer(0.3, os.kill, (owner.pid, signal.SIGKILL)).start()
    with store.create(recipe) as taken:
        assert not taken.adopted
        assert list(taken.path.iterdir()) == []
        (taken.path / "a.bin").write_bytes(b"1")
    owner.join()
    assert store.verify(recipe.ref) == []


def test_children_of_a_killed_process_do_not_keep_its_lock(store: ArtifactStore, recipe: Recipe) -> None:
    reader, writer = fork.Pipe(duplex=False)
    owner = fork.Process(target=_hang_with_child, args=(store, recipe, writer))
    owner.start()
    child = reader.recv()
    owner.kill()
    owner.join()
    assert make_slowly(store, recipe) is False
    # It was alive all the time.
    os.kill(child, signal.SIGKILL)


def test_a_waiter_takes_over_when_the_computation_fails(store: ArtifactStore, recipe: Recipe) -> None:
    begun = threading.Event()

    def fail() -> None:
        with store.create(recipe):
            begun.set()
            time.sleep(0.2)
            raise ZeroDivisionError

    with ThreadPoolExecutor(2) as pool:
        failing = pool.submit(fail)
        begun.wait()
        waiting = pool.submit(make_slowly, store, recipe)
    assert isinstance(failing.exception(), ZeroDivisionError)
    assert waiting.result() is False


def test_a_lock_excludes_while_others_sweep_and_its_file_comes_and_goes(tmp_path: Path) -> None:
    with ProcessPoolExecutor(4, mp_context=fork) as pool:
        list(pool.map(_count_under_lock, [tmp_path] * 4))
    assert (tmp_path / "counter").read_text() == "400"
    assert list((tmp_path / "locks").iterdir()) == []


def _hang(store: ArtifactStore, recipe: Recipe) -> None:
    with store.create(recipe) as draft:
        (draft.path / "begun").write_text("")
        time.sleep(60)


def _hang_with_child(store: ArtifactStore, recipe: Recipe, writer: Connection) -> None:
    with store.create(recipe):
        child = os.fork()
        if child == 0:
            time.sleep(60)
            os._exit(0)
        writer.send(child)
        time.sleep(60)


def _count_under_lock(folder: Path) -> None:
    work = Workspace(folder)
    counter = folder / "counter"
    for _ in range(100):
        with work.lock("0123456789abcdef"):
            count = int(counter.read_text()) if counter.exists() else 0
            _leave_draft(work)
            counter.write_text(str(count + 1))
        work.sweep(())


def _leave_draft(work: Workspace) -> None:
    """As a dead process leaves one, without its lock: others may sweep it away while it is made."""
    # `mkdir` with `exist_ok` raises when the folder it ran into is gone by the time it looks whether that is one.
    with suppress(FileExistsError):
        work.draft("fedcba9876543210").mkdir(parents=True, exist_ok=True)
