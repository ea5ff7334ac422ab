"""What opening an artifact reads of it: each content once a process, and none that its readers check themselves."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from juicer.artifacts import contents
from juicer.artifacts.contents import checked_when_read, known_digest
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.errors import DamagedArtifact

Make = Callable[..., ArtifactRef]

CHECKSUM = {"name": "crc32c"}
BYTES = {"name": "bytes", "configuration": {"endian": "little"}}
SHARDED = {
    "name": "sharding_indexed",
    "configuration": {"codecs": [BYTES, CHECKSUM], "index_codecs": [BYTES, CHECKSUM]},
}


@pytest.fixture
def settled(monkeypatch: pytest.MonkeyPatch) -> None:
    """Files count as old at once; whatever is written in a test must then wait for the clock of the file system."""
    monkeypatch.setattr(contents, "SETTLED_NS", 0)


@pytest.fixture
def reading(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the files that are read to the end, as they are read."""
    names: list[str] = []
    digest = contents.digest

    def noting(path: Path) -> str:
        names.append(path.name)
        return digest(path)

    monkeypatch.setattr(contents, "digest", noting)
    return names


def tick() -> None:
    """Wait until the file system gives another time."""
    time.sleep(0.05)


def test_a_process_reads_a_content_once(
    store: ArtifactStore, recipe: Recipe, make: Make, settled: None, reading: list[str]
) -> None:
    ref = make(store, recipe)
    tick()
    for _ in range(3):
        store.open(ref)
    assert sorted(reading) == ["a.bin", "b.bin", "empty"]


def test_what_was_just_written_is_not_remembered(
    store: ArtifactStore, recipe: Recipe, make: Make, reading: list[str]
) -> None:
    ref = make(store, recipe)
    store.open(ref)
    store.open(ref)
    assert reading.count("a.bin") == 2


@pytest.mark.usefixtures("settled")
def test_a_write_is_noticed_though_size_and_time_were_put_back(
    store: ArtifactStore, recipe: Recipe, make: Make
) -> None:
    ref = make(store, recipe)
    path = store.cache / str(ref) / "a.bin"
    tick()
    store.open(ref)
    facts = path.stat()
    path.write_bytes(b"9876543210")
    os.utime(path, ns=(facts.st_atime_ns, facts.st_mtime_ns))
    with pytest.raises(DamagedArtifact, match=r"file 'a\.bin' has other content"):
        store.open(ref)


@pytest.mark.usefixtures("settled")
def test_another_file_in_its_place_is_noticed(tmp_path: Path) -> None:
    path, other = tmp_path / "a", tmp_path / "b"
    path.write_bytes(b"old")
    other.write_bytes(b"new")
    tick()
    before = known_digest(path)
    facts = path.stat()
    other.replace(path)
    os.utime(path, ns=(facts.st_atime_ns, facts.st_mtime_ns))
    assert known_digest(path) != before


def test_verify_reads_everything_every_time(store: ArtifactStore, recipe: Recipe, make: Make, settled: None) -> None:
    ref = make(store, recipe)
    tick()
    store.open(ref)
    key = next(
        key for key, value in contents._digests.items() if value == known_digest(store.cache / str(ref) / "a.bin")
    )
    contents._digests[key] = "what the disk gave before it lost a bit"
    assert store.verify(ref) == []


def test_only_what_is_going_to_be_read_is_compared(
    store: ArtifactStore, recipe: Recipe, make: Make, reading: list[str]
) -> None:
    ref = make(store, recipe, {"curves.json": b"{}", "weights.safetensors": b"0123456789"})
    store.open(ref, read=["curves.json"])
    assert reading == ["curves.json"]
    weights = store.cache / str(ref) / "weights.safetensors"
    weights.write_bytes(b"9876543210")
    store.open(ref, read=["curves.json"])
    with pytest.raises(DamagedArtifact, match=r"weights\.safetensors' has other content"):
        store.open(ref)
    weights.unlink()
    with pytest.raises(DamagedArtifact, match=r"weights\.safetensors' is missing"):
        store.open(ref, read=["curves.json"])


@pytest.mark.parametrize("codecs", [[BYTES, CHECKSUM], [SHARDED]])
def test_chunks_with_checksums_are_left_to_their_readers(
    store: ArtifactStore, recipe: Recipe, make: Make, reading: list[str], codecs: list[Any]
) -> None:
    array = json.dumps({"codecs": codecs}).encode()
    ref = make(store, recipe, {"x.zarr/data/a/zarr.json": array, "x.zarr/data/a/c/0/0": b"chunk", "c/0": b"no chunk"})
    store.open(ref)
    assert reading == ["0", "zarr.json"]
    chunk = store.cache / str(ref) / "x.zarr/data/a/c/0/0"
    chunk.write_bytes(b"CHUNK")
    store.open(ref)
    (finding,) = store.verify(ref)
    assert str(finding) == "file 'x.zarr/data/a/c/0/0' has other content than when it was written"
    chunk.unlink()
    with pytest.raises(DamagedArtifact, match="c/0/0' is missing"):
        store.open(ref)


@pytest.mark.parametrize(
    "content",
    [
        {"codecs": [BYTES]},
        {"codecs": [CHECKSUM, BYTES]},
        {"codecs": [{**SHARDED, "configuration": {"codecs": [BYTES], "index_codecs": [BYTES, CHECKSUM]}}]},
        {"codecs": [{**SHARDED, "configuration": {"codecs": [BYTES, CHECKSUM], "index_codecs": [BYTES]}}]},
        {"codecs": []},
        {"codecs": ["crc32c"]},
        {"codecs": {"-1": CHECKSUM}},
        {},
        [],
        "crc32c",
        None,
    ],
)
def test_chunks_without_checksums_are_compared(tmp_path: Path, content: Any) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "zarr.json").write_text(json.dumps(content))
    assert checked_when_read(tmp_path, ["a/zarr.json", "a/c/0"]) == set()


@pytest.mark.parametrize("content", [b"", b"[" * 100_000, b"\xff", b" " * (2**24 + 1)])
def test_a_description_of_nonsense_vouches_for_nothing(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "zarr.json").write_bytes(content)
    assert checked_when_read(tmp_path, ["a/zarr.json", "a/c/0"]) == set()
