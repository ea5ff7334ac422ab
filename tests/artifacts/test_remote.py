"""Remote stores: the same promises, with objects that other machines see and a cache that may be wrong."""

from __future__ import annotations

import errno
import pickle
import shutil
import socket
import uuid
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import fsspec
import pytest

from juicer.artifacts.catalog import Catalog
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.errors import (
    ArtifactError,
    ArtifactNotFound,
    ConfigError,
    DamagedArtifact,
    StoreNotWritable,
    StoreUnreachable,
)

Make = Callable[..., ArtifactRef]
Litter = Callable[[ArtifactStore], list[str]]


@pytest.fixture(scope="module")
def s3() -> Iterator[str]:
    """A bucket on an S3 server of this process."""
    pytest.importorskip("s3fs")
    server_module = pytest.importorskip("moto.server")
    server = server_module.ThreadedMotoServer(port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("AWS_ENDPOINT_URL", f"http://{host}:{port}")
        patched.setenv("AWS_ACCESS_KEY_ID", "tester")
        patched.setenv("AWS_SECRET_ACCESS_KEY", "secret")
        patched.setenv("AWS_DEFAULT_REGION", "us-east-1")
        fsspec.filesystem("s3").mkdir("bucket")
        yield "s3://bucket"
    server.stop()


@pytest.fixture(params=["memory", "s3"])
def url(request: pytest.FixtureRequest) -> str:
    base = request.getfixturevalue("s3") if request.param == "s3" else "memory://store"
    return f"{base}/{uuid.uuid4().hex}"


@pytest.fixture
def store(url: str, tmp_path: Path) -> ArtifactStore:
    return ArtifactStore(url, cache=tmp_path / "cache")


@pytest.fixture
def elsewhere(url: str, tmp_path: Path) -> ArtifactStore:
    """The same store as another machine sees it."""
    return ArtifactStore(url, cache=tmp_path / "cache elsewhere")


def clauses(store: ArtifactStore, ref: ArtifactRef) -> list[str]:
    return [str(finding) for finding in store.verify(ref)]


def filesystem(store: ArtifactStore) -> Any:
    """The very instance that the store uses: fsspec keeps one for each set of arguments."""
    return fsspec.core.url_to_fs(store.url, use_listings_cache=False)[0]


def objects(store: ArtifactStore) -> dict[str, Any]:
    """Every object of a store by its path below the store."""
    fs, base = filesystem(store), store.url.partition("://")[2]
    return {path.split(base, 1)[1].lstrip("/"): (fs, path) for path in fs.find(base)}


def overwrite(store: ArtifactStore, ending: str, content: bytes | None) -> None:
    """Change, or with no content delete, the one object whose path ends so."""
    ((fs, path),) = [place for name, place in objects(store).items() if name.endswith(ending)]
    fs.rm_file(path) if content is None else fs.pipe_file(path, content)


def test_an_artifact_made_here_is_found_and_opened_elsewhere(
    store: ArtifactStore,
    elsewhere: ArtifactStore,
    recipe: Recipe,
    make: Make,
    payload: dict[str, bytes],
    litter: Litter,
) -> None:
    assert elsewhere.find(recipe) is None
    ref = make(store, recipe, episodes=3)
    assert elsewhere.find(recipe) == ref
    assert elsewhere.resolve(ref.id[:5]) == ref
    assert [manifest.summary for manifest in elsewhere.list()] == [{"episodes": 3}]
    assert not elsewhere.cache.exists()
    folder = elsewhere.open(ref, kind="episodes")
    assert {name: (folder / name).read_bytes() for name in payload} == payload
    assert elsewhere.verify(ref) == []
    assert litter(store) == litter(elsewhere) == []


def test_the_manifest_is_the_last_object_to_appear(
    store: ArtifactStore, recipe: Recipe, make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    fs, seen = filesystem(store), []
    original = fs.pipe_file

    def pipe_file(path: str, *arguments: Any, **options: Any) -> None:
        if path.endswith("manifest.json"):
            seen.extend(objects(store))
        original(path, *arguments, **options)

    monkeypatch.setattr(fs, "pipe_file", pipe_file)
    make(store, recipe)
    assert sorted(name.rpartition("/")[2] for name in seen) == ["a.bin", "b.bin", "empty"]


def test_nothing_but_the_artifact_is_left_in_the_store(store: ArtifactStore, recipe: Recipe, make: Make) -> None:
    ref = make(store, recipe)
    assert all(name.startswith(f"{ref}/") for name in objects(store))


def test_a_second_block_for_one_recipe_is_adopted_elsewhere(
    store: ArtifactStore, elsewhere: ArtifactStore, recipe: Recipe, make: Make
) -> None:
    make(store, recipe)
    with elsewhere.create(recipe) as draft:
        assert draft.adopted


def test_an_opened_artifact_is_not_downloaded_again(
    store: ArtifactStore, recipe: Recipe, make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    ref = make(store, recipe)
    before = store.open(ref)
    monkeypatch.setattr(filesystem(store), "get", None)
    assert store.open(ref) == before


@pytest.mark.parametrize("damage", ["altered", "deleted", "gone"])
def test_a_damaged_copy_in_the_cache_is_replaced(
    store: ArtifactStore, recipe: Recipe, make: Make, payload: dict[str, bytes], damage: str
) -> None:
    ref = make(store, recipe)
    copy = store.open(ref)
    if damage == "altered":
        (copy / "a.bin").write_bytes(b"9876543210")
    elif damage == "deleted":
        (copy / "manifest.json").unlink()
    else:
        shutil.rmtree(copy)
    assert (store.open(ref) / "a.bin").read_bytes() == payload["a.bin"]


def test_a_chunk_that_the_cache_lost_is_downloaded_again_after_a_look_at_everything(
    store: ArtifactStore, recipe: Recipe, make: Make
) -> None:
    array = b'{"codecs": [{"name": "crc32c"}]}'
    ref = make(store, recipe, {"x.zarr/a/zarr.json": array, "x.zarr/a/c/0": b"chunk"})
    chunk = store.open(ref) / "x.zarr/a/c/0"
    chunk.write_bytes(b"CHUNK")
    # Whoever reads the array finds it.
    store.open(ref)
    assert store.verify(ref) == []
    assert (store.open(ref) / "x.zarr/a/c/0").read_bytes() == b"chunk"


def test_a_repaired_artifact_replaces_the_copies_of_the_old_one(
    store: ArtifactStore, elsewhere: ArtifactStore, recipe: Recipe, make: Make
) -> None:
    ref = make(store, recipe, {"a.bin": b"old"})
    elsewhere.open(ref)
    store.set_aside(ref)
    make(store, recipe, {"a.bin": b"new"})
    assert (elsewhere.open(ref) / "a.bin").read_bytes() == b"new"


@pytest.mark.parametrize("damaged", ["", "a.bin", "extra", "manifest.json"])
@pytest.mark.parametrize("content", [b"old", b"new"])
def test_an_artifact_is_replaced_in_its_place_with_all_that_was_left_of_it(
    store: ArtifactStore, elsewhere: ArtifactStore, recipe: Recipe, make: Make, damaged: str, content: bytes
) -> None:
    ref = make(store, recipe, {"a.bin": b"old", "b.bin": b"same"})
    elsewhere.open(ref)
    if damaged == "extra":
        ((fs, path),) = [place for name, place in objects(store).items() if name.endswith("a.bin")]
        fs.pipe_file(path.replace("a.bin", "extra"), b"")
    elif damaged:
        overwrite(store, damaged, b"{}")
    make(elsewhere, recipe, {"a.bin": content, "b.bin": b"same"}, replacing=True)
    for machine in (store, elsewhere):
        assert machine.verify(ref) == []
        assert (machine.open(ref) / "a.bin").read_bytes() == content
    in_place = [name for name in objects(store) if name.startswith(f"{ref}/")]
    assert len(in_place) == 3
    # What was not as it was written may be all that is left of something.
    assert len(store.asides(ref)) == (damaged != "")


def test_an_artifact_stays_for_everyone_if_the_upload_of_its_successor_fails(
    store: ArtifactStore, elsewhere: ArtifactStore, recipe: Recipe, make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    ref = make(store, recipe, {"a.bin": b"old"})
    with monkeypatch.context() as patched:
        patched.setattr(filesystem(store), "put", None)
        with pytest.raises(StoreNotWritable):
            make(store, recipe, {"a.bin": b"new"}, replacing=True)
    for machine in (store, elsewhere):
        assert (machine.open(ref) / "a.bin").read_bytes() == b"old"


@pytest.mark.parametrize(
    ("ending", "content", "problem"),
    [
        ("a.bin", None, "file 'a.bin' is missing"),
        ("a.bin", b"", "file 'a.bin' has 0 bytes instead of 10"),
        ("a.bin", b"0123456780", "file 'a.bin' has other content than when it was written"),
        ("manifest.json", b"{}", "file 'manifest.json' is unusable: it is not a manifest"),
    ],
)
def test_damage_in_the_store_is_noticed(
    store: ArtifactStore,
    elsewhere: ArtifactStore,
    recipe: Recipe,
    make: Make,
    litter: Litter,
    ending: str,
    content: bytes | None,
    problem: str,
) -> None:
    ref = make(store, recipe)
    overwrite(store, ending, content)
    assert clauses(elsewhere, ref) == clauses(store, ref) == [problem]
    with pytest.raises(DamagedArtifact, match=problem):
        elsewhere.open(ref)
    assert litter(elsewhere) == []


def test_an_extra_object_is_noticed_and_never_downloaded(
    store: ArtifactStore, elsewhere: ArtifactStore, recipe: Recipe, make: Make
) -> None:
    ref = make(store, recipe)
    ((fs, path),) = [place for name, place in objects(store).items() if name.endswith("a.bin")]
    fs.pipe_file(path.replace("a.bin", "extra"), b"")
    assert clauses(elsewhere, ref) == ["file 'extra' does not belong to it"]


def test_an_artifact_set_aside_is_gone_for_everyone_and_kept(
    store: ArtifactStore, elsewhere: ArtifactStore, recipe: Recipe, make: Make
) -> None:
    for number in (1, 2):
        ref = make(elsewhere, recipe)
        before = {name.removeprefix(f"{ref}/"): fs.cat_file(path) for name, (fs, path) in objects(store).items()}
        aside = elsewhere.set_aside(ref)
        assert aside == f"{store.url}/.aside/{ref}/{number}"
        assert store.find(recipe) is None
        kept = {name: fs.cat_file(path) for name, (fs, path) in objects(store).items()}
        prefix = f".aside/{ref}/{number}/"
        assert {name.removeprefix(prefix): kept[name] for name in kept if name.startswith(prefix)} == {
            name: content for name, content in before.items() if not name.startswith(".aside")
        }
        with pytest.raises(ArtifactNotFound):
            store.open(ref)
    assert store.asides(ref) == [f"{store.url}/.aside/{ref}/{number}" for number in (1, 2)]


def test_an_interrupted_upload_is_finished_without_computing_again(
    store: ArtifactStore, elsewhere: ArtifactStore, recipe: Recipe, make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:

    def put(*arguments: object, **options: object) -> None:
        raise ConnectionResetError("connection reset by peer")

    with monkeypatch.context() as patched:
        patched.setattr(filesystem(store), "put", put)
        with pytest.raises(StoreUnreachable, match="cannot be written: connection reset by peer; check its address"):
            make(store, recipe)
    assert store.find(recipe) is None
    assert store.refs() == []
    with store.create(recipe) as draft:
        assert draft.adopted
    assert elsewhere.verify(recipe.ref) == []


def test_a_damaged_copy_is_not_uploaded_but_computed_again(
    store: ArtifactStore, recipe: Recipe, make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patched:
        patched.setattr(filesystem(store), "put", None)
        with pytest.raises(StoreNotWritable):
            make(store, recipe)
    (store.cache / str(recipe.ref) / "a.bin").unlink()
    make(store, recipe)
    assert store.verify(recipe.ref) == []


@pytest.mark.parametrize("same", [True, False])
def test_of_two_machines_that_finish_together_the_first_is_kept(
    store: ArtifactStore, elsewhere: ArtifactStore, recipe: Recipe, make: Make, same: bool
) -> None:
    with elsewhere.create(recipe) as late:
        (late.path / "a.bin").write_bytes(b"first" if same else b"second")
        make(store, recipe, {"a.bin": b"first"})
    for machine in (store, elsewhere):
        assert (machine.open(recipe.ref) / "a.bin").read_bytes() == b"first"
        assert machine.verify(recipe.ref) == []
    assert len(objects(store)) == 2


def test_a_store_that_cannot_be_written_is_found_out_before_the_work(
    store: ArtifactStore, recipe: Recipe, monkeypatch: pytest.MonkeyPatch
) -> None:

    def refuse(*arguments: object, **options: object) -> None:
        raise PermissionError("Access Denied")

    monkeypatch.setattr(filesystem(store), "pipe_file", refuse)
    with pytest.raises(StoreNotWritable, match="cannot be written: Access Denied"), store.create(recipe):
        pytest.fail("the block must not run")


def test_an_id_is_looked_up_without_asking_for_every_other_artifact(
    store: ArtifactStore, recipe: Recipe, make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    refs = [make(store, replace(recipe, config={"seed": seed})) for seed in range(4)]
    asked: list[str] = []
    exists = filesystem(store).exists
    monkeypatch.setattr(filesystem(store), "exists", lambda path, **options: asked.append(path) or exists(path))
    for text in (str(refs[2]), refs[2].id, refs[2].id[:8]):
        asked.clear()
        assert store.resolve(text) == refs[2]
        assert len(asked) == 1


def test_a_list_that_has_not_changed_is_made_by_one_look(
    store: ArtifactStore, recipe: Recipe, make: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    refs = [make(store, replace(recipe, config={"seed": seed})) for seed in range(4)]
    catalog = Catalog(store, tmp_path)
    catalog.whole()
    looks: list[str | None] = []
    survey = ArtifactStore.survey
    monkeypatch.setattr(ArtifactStore, "survey", lambda store, *about: looks.append("") or survey(store, *about))
    reads: list[ArtifactRef] = []
    manifest = ArtifactStore.manifest
    monkeypatch.setattr(ArtifactStore, "manifest", lambda store, ref: reads.append(ref) or manifest(store, ref))
    assert len(catalog.whole(recipe.kind, trusts_unstamped=True).entries) == 4
    assert (len(looks), reads) == (1, [])
    assert len(catalog.whole(recipe.kind).entries) == 4
    assert (len(looks), sorted(reads)) == (2, sorted(refs))


def test_a_store_that_does_not_answer_is_told_from_one_that_refuses(
    s3: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = ArtifactStore(f"{s3}/{uuid.uuid4().hex}", cache=tmp_path)
    (free := socket.socket()).bind(("127.0.0.1", 0))
    monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{free.getsockname()[1]}")
    free.close()
    fsspec.get_filesystem_class("s3").clear_instance_cache()
    monkeypatch.setattr("s3fs.core.S3FileSystem.retries", 1)
    try:
        with pytest.raises(StoreUnreachable, match="cannot be read: Could not connect") as caught:
            store.survey()
    finally:
        fsspec.get_filesystem_class("s3").clear_instance_cache()
    # As it comes out of the process of a stage, without what it arose from.
    assert isinstance(pickle.loads(pickle.dumps(caught.value)), StoreUnreachable)


def test_a_bucket_that_does_not_exist_is_found_out_before_the_work(s3: str, recipe: Recipe, tmp_path: Path) -> None:
    store = ArtifactStore("s3://nowhere/at/all", cache=tmp_path)
    assert store.find(recipe) is None
    with pytest.raises(StoreNotWritable, match="s3://nowhere"), store.create(recipe):
        pytest.fail("the block must not run")


def test_an_unknown_protocol_is_refused(recipe: Recipe, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="'ftpx://host' cannot be used"):
        ArtifactStore("ftpx://host", cache=tmp_path).find(recipe)


def test_a_server_that_is_away_is_named(
    s3: str, recipe: Recipe, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:9")
    monkeypatch.setenv("AWS_MAX_ATTEMPTS", "1")
    fsspec.filesystem("s3").clear_instance_cache()
    try:
        with pytest.raises(ArtifactError, match=r"cannot be read: .*; check its address"):
            ArtifactStore(f"{s3}/x", cache=tmp_path).find(recipe)
    finally:
        fsspec.filesystem("s3").clear_instance_cache()


def test_foreign_objects_are_no_artifacts_and_stay(store: ArtifactStore, recipe: Recipe, make: Make) -> None:
    ref = make(store, recipe)
    fs, base = filesystem(store), store.url.partition("://")[2]
    names = ["notes/manifest.json", f"{ref.id}.before/manifest.json", "0123456789ABCDEF/manifest.json", "readme.txt"]
    for name in names:
        fs.pipe_file(f"{base}/episodes/{name}", b"mine")
    fs.pipe_file(f"{base}/episodes/0123456789abcdef/begun/a.bin", b"an upload that is not finished")
    assert store.refs() == [ref]
    assert [manifest.ref for manifest in store.list()] == [ref]
    assert store.verify(ref) == []
    make(store, recipe, {"a.bin": b"new"}, replacing=True)
    assert {f"episodes/{name}" for name in names} <= set(objects(store))


@pytest.mark.parametrize("name", [".DS_Store", "deep/._a.bin"])
def test_litter_in_the_store_or_in_the_cache_stops_nothing(
    store: ArtifactStore, elsewhere: ArtifactStore, recipe: Recipe, make: Make, name: str
) -> None:
    ref = make(store, recipe)
    ((fs, path),) = [place for path, place in objects(store).items() if path.endswith("a.bin")]
    fs.pipe_file(path.replace("a.bin", name), b"x")
    (store.open(ref) / name).write_bytes(b"x")
    for machine in (store, elsewhere):
        assert (machine.open(ref) / "a.bin").is_file()
        assert clauses(machine, ref) == [f"file '{name}' does not belong to it"]
    assert (store.open(ref) / name).exists()


@pytest.mark.parametrize(
    "content", [b"", b"{}", b"[" * 10**5, b" " * (2**24 + 1)], ids=["empty", "other", "deep", "huge"]
)
def test_a_damaged_manifest_is_restored_from_a_copy_that_is_whole(
    store: ArtifactStore, elsewhere: ArtifactStore, recipe: Recipe, make: Make, content: bytes
) -> None:
    ref = make(store, recipe)
    overwrite(store, "manifest.json", content)
    assert "manifest.json" in clauses(elsewhere, ref)[0]
    assert not elsewhere.mend(ref)
    assert store.mend(ref)
    assert elsewhere.verify(ref) == []
    assert len(store.asides(ref)) == 1


def test_a_manifest_that_was_written_into_is_restored_without_a_copy(
    store: ArtifactStore, elsewhere: ArtifactStore, recipe: Recipe, make: Make
) -> None:
    ref = make(store, recipe)
    ((fs, path),) = [place for name, place in objects(store).items() if name.endswith("manifest.json")]
    fs.pipe_file(path, fs.cat_file(path) + b"\n")
    assert elsewhere.mend(ref)
    assert elsewhere.verify(ref) == store.verify(ref) == []


def test_damaged_files_are_restored_from_a_copy_that_is_whole(
    store: ArtifactStore, elsewhere: ArtifactStore, recipe: Recipe, make: Make
) -> None:
    ref = make(store, recipe)
    overwrite(store, "a.bin", b"9876543210")
    assert not elsewhere.mend(ref)
    assert store.mend(ref)
    assert elsewhere.verify(ref) == []
    assert len(objects(store)) == 2 * 4


def test_an_object_of_another_size_is_not_downloaded(
    store: ArtifactStore, elsewhere: ArtifactStore, recipe: Recipe, make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    ref = make(store, recipe)
    overwrite(store, "a.bin", bytes(10**6))
    fs, fetched = filesystem(store), []
    original = fs.get

    def get(remote: list[str], local: list[str], **options: Any) -> Any:
        fetched.extend(remote)
        return original(remote, local, **options)

    monkeypatch.setattr(fs, "get", get)
    assert clauses(elsewhere, ref) == ["file 'a.bin' has 1000000 bytes instead of 10"]
    assert fetched
    assert not any(path.endswith("a.bin") for path in fetched)


def test_an_upload_cut_short_is_not_lost_because_of_what_lies_in_the_copy(
    store: ArtifactStore, elsewhere: ArtifactStore, recipe: Recipe, make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patched:
        patched.setattr(filesystem(store), "put", None)
        with pytest.raises(StoreNotWritable):
            make(store, recipe)
    (store.cache / str(recipe.ref) / "notes.txt").write_text("mine")
    with store.create(recipe) as draft:
        assert draft.adopted
    assert elsewhere.verify(recipe.ref) == []


def test_a_copy_that_was_never_uploaded_is_set_aside_if_it_is_damaged(
    store: ArtifactStore, recipe: Recipe, make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patched:
        patched.setattr(filesystem(store), "put", None)
        with pytest.raises(StoreNotWritable):
            make(store, recipe)
    (store.cache / str(recipe.ref) / "a.bin").write_bytes(b"x")
    make(store, recipe)
    aside = store.cache / ".aside" / str(recipe.ref) / "1"
    assert (aside / "a.bin").read_bytes() == b"x"


def test_a_full_disk_under_the_cache_is_not_blamed_on_the_network(
    store: ArtifactStore, elsewhere: ArtifactStore, recipe: Recipe, make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    ref = make(store, recipe)

    def get(*arguments: object, **options: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(filesystem(store), "get", get)
    with pytest.raises(StoreNotWritable, match=rf"'{elsewhere.cache}' cannot be written: the disk is full"):
        elsewhere.open(ref)


def test_a_refused_listing_is_not_taken_for_an_empty_store(
    s3: str, recipe: Recipe, make: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = pytest.importorskip("moto.settings")
    store = ArtifactStore(f"{s3}/{uuid.uuid4().hex}", cache=tmp_path)
    ref = make(store, recipe)
    with monkeypatch.context() as patched:
        # The server, which runs in this process, knows no user, and from now on asks for one.
        patched.setattr(settings, "INITIAL_NO_AUTH_ACTION_COUNT", 0)
        for action in (
            store.survey,
            lambda: store.resolve(ref.id),
            lambda: store.find(recipe),
            lambda: store.verify(ref),
        ):
            with pytest.raises(ArtifactError, match=r"cannot be read: .*; check its address, credentials and network"):
                action()
    assert store.refs() == [ref]
