"""Small recipes, and a store to keep their artifacts."""

from __future__ import annotations

import multiprocessing
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore

Make = Callable[..., ArtifactRef]
Fail = Callable[..., None]
Litter = Callable[[ArtifactStore], list[str]]
AsNobody = Callable[[Callable[[], Any]], Any]

NOBODY = 65534

PAYLOAD = {"a.bin": b"0123456789", "deep/er/b.bin": bytes(range(256)), "empty": b""}


@pytest.fixture
def store(tmp_path: Path) -> ArtifactStore:
    return ArtifactStore(tmp_path / "store")


@pytest.fixture
def recipe() -> Recipe:
    return Recipe(
        stage="ingest",
        kind="episodes",
        config={"seed": 3, "limits": {"low": 0.5}},
        code="c0de",
        files={"log": "ab" * 32},
        libraries={"numpy": "2.4.6"},
    )


@pytest.fixture
def payload() -> dict[str, bytes]:
    """Files of the artifacts that ``make`` makes."""
    return dict(PAYLOAD)


@pytest.fixture
def make() -> Make:
    """Commits an artifact: ``make(store, recipe)``, ``make(store, recipe, {"a.bin": b"..."})``."""

    def commit(
        store: ArtifactStore,
        recipe: Recipe,
        payload: Mapping[str, bytes] = PAYLOAD,
        *,
        replacing: bool = False,
        **summary: Any,
    ) -> ArtifactRef:
        with store.create(recipe, replacing=replacing) as draft:
            assert not draft.adopted
            draft.summary.update(summary)
            for name, content in payload.items():
                path = draft.path / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(content)
        return draft.ref

    return commit


@pytest.fixture
def fail() -> Fail:
    """Begins an artifact, leaves something in its scratch, and raises: ``fail(store, recipe, ZeroDivisionError())``."""

    def begin(store: ArtifactStore, recipe: Recipe, error: BaseException, *, replacing: bool = False) -> None:
        with store.create(recipe, replacing=replacing) as draft:
            (draft.path / "half").write_bytes(b"1")
            (draft.scratch / "step-100").write_bytes(b"resume from here")
            raise error

    return begin


@pytest.fixture
def litter() -> Litter:
    """Everything in the hidden work folder of a store but its fixed folders."""

    def find(store: ArtifactStore) -> list[str]:
        work = store.cache / ".work"
        paths = [path.relative_to(work).as_posix() for path in work.rglob("*")]
        return sorted(path for path in paths if "/" in path)

    return find


@pytest.fixture
def open_place() -> Iterator[Path]:
    """A folder that every user may enter; pytest's own are closed to others."""
    place = Path(tempfile.mkdtemp(prefix="juicer-test-"))
    place.chmod(0o755)
    yield place
    for folder in (place, *(path for path in place.rglob("*") if path.is_dir() and not path.is_symlink())):
        folder.chmod(0o755)
    shutil.rmtree(place)


@pytest.fixture
def as_nobody() -> AsNobody:
    """Calls a function in a process without any special rights: ``as_nobody(lambda: store.verify(ref))``.

    Gives what the function gives, or raises what it raises.
    """

    def call(function: Callable[[], Any]) -> Any:
        context = multiprocessing.get_context("fork")
        receiving, sending = context.Pipe(duplex=False)

        def work() -> None:
            if os.geteuid() == 0:
                os.setgroups([])
                os.setgid(NOBODY)
                os.setuid(NOBODY)
            try:
                sending.send((function(), None))
            except BaseException as error:
                sending.send((None, error))

        process = context.Process(target=work)
        process.start()
        sending.close()
        result, error = receiving.recv()
        process.join()
        if error is not None:
            raise error
        return result

    return call


@pytest.fixture(scope="session")
def every_kind(tmp_path_factory: pytest.TempPathFactory) -> ArtifactStore:
    """A small artifact of every kind, written by what writes the real ones. Tests work on copies."""
    # Imported here: most tests of this folder need none of what it imports.
    from tests.artifacts.every_kind import write_every_kind

    return write_every_kind(ArtifactStore(tmp_path_factory.mktemp("every kind") / "store"))
