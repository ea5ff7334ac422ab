"""Whatever happens to the files of an artifact is noticed: when it is verified, and before anything wrong is read.

Most is noticed when it is opened. Chunks of arrays, of which there may be gigabytes, are compared with their checksums
when they are read; that they are there, and of their sizes, is noticed at the opening too.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from juicer.artifacts.findings import Nature
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import KINDS, ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.config import canonical_json
from juicer.errors import ArtifactError, DamagedArtifact, StrayFile, UnreadableArtifact
from juicer.storage.columns import ColumnReader
from juicer.storage.episodes import EpisodeReader
from juicer.storage.evaluations import EXAMPLES

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


def replace_by_pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def replace_by_dangling_link(path: Path) -> None:
    path.unlink()
    path.symlink_to(path.parent / "nowhere")


def replace_by_endless_device(path: Path) -> None:
    path.unlink()
    path.symlink_to("/dev/zero")


def add_file_beside(path: Path) -> None:
    path.with_name("extra").write_bytes(b"mine")


def add_folder_beside(path: Path) -> None:
    (path.parent / "extra" / "deep").mkdir(parents=True)


def add_file_in_folder_beside(path: Path) -> None:
    (path.parent / "extra").mkdir()
    (path.parent / "extra" / path.name).write_bytes(b"mine")


def add_pipe_beside(path: Path) -> None:
    os.mkfifo(path.with_name("extra"))


def add_unspeakable_file_beside(path: Path) -> None:
    os.close(os.open(os.fsencode(path.parent) + b"/\xff\x1b[2J\n", os.O_CREAT))


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
    replace_by_pipe,
    replace_by_dangling_link,
    replace_by_endless_device,
)
STRAYS = (add_file_beside, add_file_in_folder_beside, add_pipe_beside, add_unspeakable_file_beside)
LITTERS = (add_folder_beside,)


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


MOST_WORDS = 1000


def is_chunk(path: str) -> bool:
    return ".zarr/" in path and "/c/" in path


@pytest.fixture(scope="module")
def kinds(every_kind: ArtifactStore, tmp_path_factory: pytest.TempPathFactory) -> ArtifactStore:
    """A copy of the store with an artifact of every kind, of this module's own."""
    place = tmp_path_factory.mktemp("kinds") / "store"
    shutil.copytree(every_kind.cache, place)
    return ArtifactStore(place)


def files_of(folder: Path) -> list[Path]:
    return sorted(path.relative_to(folder) for path in folder.rglob("*") if path.is_file())


def state(folder: Path) -> dict[bytes, tuple[int, ...]]:
    """What the file system says about everything below a folder; whatever is written changes that."""
    tree = os.walk(os.fsencode(folder))
    paths = [os.path.join(parent, name) for parent, folders, files in tree for name in folders + files]  # noqa: PTH118
    facts = {path: os.lstat(path) for path in paths}
    return {path: (each.st_mode, each.st_ino, each.st_size, each.st_mtime_ns) for path, each in facts.items()}


def damaged(store: ArtifactStore, ref: ArtifactRef, damages: tuple[Callable[[Path], None], ...]) -> Iterator[str]:
    """Do each damage to each file in turn, and put everything right again after each."""
    folder = store.cache / str(ref)
    whole = store.cache.with_name("whole")
    shutil.copytree(folder, whole)
    for path in files_of(folder):
        for damage in damages:
            damage(folder / path)
            yield f"{damage.__name__}: {path}"
            shutil.rmtree(folder)
            shutil.copytree(whole, folder)
    shutil.rmtree(whole)


def use(store: ArtifactStore, ref: ArtifactRef) -> None:
    """Open an artifact and read all of its arrays; whatever else it holds is compared when it is opened."""
    folder = store.open(ref)
    if ref.kind == "columns":
        columns = ColumnReader(folder)
        for name in columns.schema.names():
            columns.steps(name)
    for place in (folder, folder / EXAMPLES):
        if (place / "episodes.zarr").exists():
            episodes = EpisodeReader(place)
            for index in range(len(episodes)):
                episodes.read(index)


def complaint(store: ArtifactStore, ref: ArtifactRef, error_type: type[ArtifactError]) -> str:
    """The sentence with which an artifact is refused; nothing in the store may change by that."""
    before = state(store.cache)
    with pytest.raises(error_type) as caught:
        use(store, ref)
    assert state(store.cache) == before
    sentence = str(caught.value)
    assert sentence.isprintable()
    assert len(sentence) < MOST_WORDS
    return sentence


@pytest.mark.parametrize("kind", KINDS)
def test_every_damage_to_every_file_of_every_kind_is_noticed_and_nothing_is_touched(
    kinds: ArtifactStore, kind: str
) -> None:
    (ref,) = kinds.refs(kind)
    for case in damaged(kinds, ref, DAMAGES):
        if case == "replace_by_link: manifest.json":
            assert kinds.verify(ref) == []
            continue
        assert any(finding.nature is Nature.DAMAGE for finding in kinds.verify(ref)), case
        assert f"recompute it with `juicer repair {ref.id}`" in complaint(kinds, ref, DamagedArtifact), case
        if not (is_chunk(case) and case.startswith(("zero", "flip"))):
            with pytest.raises(DamagedArtifact):
                kinds.open(ref)
    assert all(kinds.verify(each) == [] for each in kinds.refs())


@pytest.mark.parametrize("kind", KINDS)
def test_whatever_does_not_belong_is_noticed_wherever_it_lies(kinds: ArtifactStore, kind: str) -> None:
    (ref,) = kinds.refs(kind)
    for case in damaged(kinds, ref, STRAYS):
        assert {finding.nature for finding in kinds.verify(ref)} == {Nature.STRAY}, case
        assert "does not belong to it; remove that from" in complaint(kinds, ref, StrayFile)
    for case in damaged(kinds, ref, LITTERS):
        (finding,) = kinds.verify(ref)
        assert finding.nature is Nature.LITTER, case
        kinds.open(ref)


def test_at_least_464_damages_are_tried(kinds: ArtifactStore, capsys: pytest.CaptureFixture[str]) -> None:
    files = sum(len(files_of(kinds.cache / str(ref))) for ref in kinds.refs())
    count = files * len(DAMAGES + STRAYS + LITTERS) + len(KINDS) * len(EDITS)
    with capsys.disabled():
        sys.stdout.write(f"\n{count} damages are tried, on {files} files\n")
    assert count >= 464


def resealed(text: str, change: Callable[[dict[str, Any]], None]) -> str:
    """A manifest as somebody might compose it who knows how juicer seals them."""
    body = json.loads(text)
    del body["sha256"]
    change(body)
    digest = hashlib.sha256(canonical_json(body).encode()).hexdigest()
    return json.dumps({**body, "sha256": digest}, indent=1, sort_keys=True) + "\n"


def nested(levels: int) -> Any:
    value: Any = 1
    for _ in range(levels):
        value = [value]
    return value


EDITS: dict[str, Callable[[dict[str, Any]], None]] = {
    **{
        f"{key} is {value!r}": lambda body, key=key, value=value: body.update({key: value})
        for key in ("recipe", "files", "summary", "host", "started", "finished", "seconds", "schema_version")
        for value in (None, [], {}, "x", -1, [[]], True)
        if (key, value) not in (("files", []), ("summary", {}), ("host", {}), ("seconds", -1))
    },
    **{
        f"without {key}": lambda body, key=key: body.pop(key)
        for key in ("recipe", "files", "summary", "host", "started", "finished", "seconds", "schema_version")
    },
    "file without size": lambda body: body["files"][0].pop("bytes"),
    "file of less than nothing": lambda body: body["files"][0].update(bytes=-1),
    "file without name": lambda body: body["files"][0].update(path=""),
    "file that is the folder": lambda body: body["files"][0].update(path="."),
    "file with null": lambda body: body["files"][0].update(path="a\0b"),
    "file elsewhere": lambda body: body["files"][0].update(path="../../../etc/passwd"),
    "file with a number for a name": lambda body: body["files"][0].update(path=3),
    "file of another content": lambda body: body["files"][0].update(sha256="00" * 32),
    "file that is not there": lambda body: body["files"].append({"path": "gone", "bytes": 1, "sha256": "00" * 32}),
    "file left out": lambda body: body["files"].pop(),
    "kind": lambda body: body["recipe"].update(kind="\x1b[2J" * 10**6),
    "kind of another": lambda body: body["recipe"].update(
        kind="logs" if body["recipe"]["kind"] != "logs" else "report"
    ),
    "stage": lambda body: body["recipe"].update(stage=[]),
    "inputs": lambda body: body["recipe"].update(inputs={"a": ["../.."]}),
    "inputs of another kind": lambda body: body["recipe"].update(inputs={"a": [3]}),
    "config": lambda body: body["recipe"].update(config={"other": 1}),
    "deep": lambda body: body["summary"].update(deep=nested(500)),
    "without offset": lambda body: body.update(finished="2026-01-01T00:00:00"),
    "no time": lambda body: body.update(finished="\x1b[2Jyesterday"),
    "more": lambda body: body.update(more=1),
    "later": lambda body: body.update(schema_version=99),
}


@pytest.mark.parametrize("kind", KINDS)
def test_whatever_a_forged_manifest_says_is_refused_in_one_sentence(kinds: ArtifactStore, kind: str) -> None:
    (ref,) = kinds.refs(kind)
    path = kinds.cache / str(ref) / "manifest.json"
    text = path.read_text()
    for name, change in EDITS.items():
        path.write_text(resealed(text, change))
        assert kinds.verify(ref), name
        if name == "file of another content" and is_chunk(json.loads(text)["files"][0]["path"]):
            # A chunk that is whole by its own checksum is read, whatever else is said of it.
            continue
        error_type = {"later": UnreadableArtifact, "file left out": StrayFile}.get(name, DamagedArtifact)
        complaint(kinds, ref, error_type)
        assert [manifest.ref for manifest in kinds.list(kind)] in ([], [ref]), name
    path.write_text(text)
    assert kinds.verify(ref) == []


@pytest.mark.parametrize(
    "content",
    [
        b"[" * 100_000,
        b'{"a":' * 100_000,
        b'{"schema_version": 1, "sha256": "", "seconds": ' + b"9" * 5000 + b"}",
        b'{"schema_version": 1, "sha256": "", "seconds": NaN}',
        b'{"schema_version": 1, "sha256": "", "seconds": 1e999}',
        b'{"schema_version": 1, "sha256": ' + b"[" * 900 + b"]" * 900 + b"}",
        b"[]",
        b"null",
        b"1",
        b"\xff\xfe",
        b"\0" * 100,
        b'{"schema_version": "' + b"x" * 10**6 + b'"}',
        b" " * (2**24 + 1),
    ],
    ids=[
        "deep lists",
        "deep",
        "digits",
        "nan",
        "infinite",
        "seal",
        "list",
        "null",
        "number",
        "bytes",
        "zeros",
        "long",
        "huge",
    ],
)
def test_a_manifest_that_is_hostile_is_refused_in_one_sentence(
    store: ArtifactStore, recipe: Recipe, make: Make, content: bytes
) -> None:
    ref = make(store, recipe)
    (store.cache / str(ref) / "manifest.json").write_bytes(content)
    assert "file 'manifest.json' is unusable" in complaint(store, ref, DamagedArtifact)
    assert store.list() == []


def test_a_manifest_of_a_later_juicer_is_not_called_damaged(store: ArtifactStore, recipe: Recipe, make: Make) -> None:
    ref = make(store, recipe)
    path = store.cache / str(ref) / "manifest.json"
    path.write_text(resealed(path.read_text(), EDITS["later"]))
    with pytest.raises(UnreadableArtifact, match=r"may be whole, but .* has schema version 99.*; use the juicer that"):
        store.open(ref)


def test_damage_by_rights_is_not_taken_for_damage(
    every_kind: ArtifactStore, open_place: Path, as_nobody: Callable[[Callable[[], Any]], Any]
) -> None:
    shutil.copytree(every_kind.cache, open_place / "store")
    store = ArtifactStore(open_place / "store")
    for path in (store.cache, *store.cache.rglob("*")):
        path.chmod(0o755 if path.is_dir() else 0o644)

    def looked_at(ref: ArtifactRef) -> set[Nature]:
        with pytest.raises(UnreadableArtifact):
            store.open(ref)
        return {finding.nature for finding in store.verify(ref)}

    for ref in store.refs():
        folder = store.cache / str(ref)
        for path in [folder, *folder.rglob("*")]:
            before = path.stat().st_mode
            path.chmod(0)
            try:
                assert as_nobody(lambda ref=ref: looked_at(ref)) == {Nature.UNREADABLE}, path
            finally:
                path.chmod(before)
