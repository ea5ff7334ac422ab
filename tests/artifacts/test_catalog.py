"""Lists know what is in a store without reading every manifest each time, and show what was written since."""

from __future__ import annotations

import json
import os
import shutil
import signal
import stat
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from juicer.artifacts.catalog import FILE, Catalog
from juicer.artifacts.manifest import MANIFEST_NAME
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore


@pytest.fixture
def store(tmp_path: Path) -> ArtifactStore:
    return ArtifactStore(tmp_path / "store")


@pytest.fixture
def refs(store: ArtifactStore) -> list[ArtifactRef]:
    """Three artifacts, each made from the one before."""
    refs: list[ArtifactRef] = []
    for stage, kind in (("record", "logs"), ("ingest", "episodes"), ("train", "checkpoint")):
        with store.create(Recipe(stage, kind, {"parents": tuple(refs[-1:])})) as draft:
            draft.summary["headline"] = f"made by {stage}"
        refs.append(draft.ref)
    return refs


@pytest.fixture
def reads(monkeypatch: pytest.MonkeyPatch) -> list[ArtifactRef]:
    """Manifests that were read so far."""
    read, refs = ArtifactStore.manifest, []

    def counting(self, ref):
        refs.append(ref)
        return read(self, ref)

    monkeypatch.setattr(ArtifactStore, "manifest", counting)
    return refs


def listed(store: ArtifactStore, folder: Path, kind: str | None = None) -> dict[ArtifactRef, str]:
    """What a process that starts now lists."""
    entries = Catalog(store, folder).whole(kind).entries
    return {entry.ref: entry.trouble or entry.headline for entry in entries}


def test_the_next_process_reads_no_manifest_again(store, refs, reads, tmp_path):
    first = Catalog(store, tmp_path).whole()
    assert [entry.ref for entry in first.entries] == refs[::-1]
    assert sorted(reads) == sorted(refs)
    reads.clear()
    assert Catalog(store, tmp_path).whole() == first
    assert reads == []


def test_a_list_of_one_kind_reads_only_these_and_keeps_what_is_known_of_others(store, refs, reads, tmp_path):
    assert set(listed(store, tmp_path, "episodes")) == {refs[1]}
    assert reads == [refs[1]]
    listed(store, tmp_path, "logs")
    listed(store, tmp_path)
    assert sorted(reads) == sorted(refs)


@pytest.mark.parametrize("change", [lambda text: text[:50], lambda text: text.replace("made by", "made at")])
def test_a_manifest_that_was_altered_since_is_found(store, refs, tmp_path, change):
    listed(store, tmp_path)
    path = store.cache / str(refs[1]) / MANIFEST_NAME
    whole = path.read_text()
    path.write_text(change(whole))
    assert "is damaged" in listed(store, tmp_path)[refs[1]]
    path.write_text(whole)
    assert listed(store, tmp_path)[refs[1]] == "made by ingest"


def test_an_artifact_that_is_gone_is_listed_no_more_and_comes_back(store, refs, tmp_path):
    listed(store, tmp_path)
    aside = Path(store.set_aside(refs[0]))
    assert set(listed(store, tmp_path)) == set(refs[1:])
    aside.rename(store.cache / str(refs[0]))
    assert set(listed(store, tmp_path)) == set(refs)


@pytest.mark.parametrize("is_stamped", [True, False])
def test_of_some_artifacts_only_these_are_read_and_one_that_is_gone_is_no_longer_known(
    store, refs, reads, tmp_path, monkeypatch, is_stamped
):
    if not is_stamped:
        monkeypatch.setattr(ArtifactStore, "stamp", lambda self, ref: "")
    catalog = Catalog(store, tmp_path)
    assert {ref: entry.headline for ref, entry in catalog.of(refs[:2]).items()} == {
        refs[0]: "made by record",
        refs[1]: "made by ingest",
    }
    assert sorted(reads) == sorted(refs[:2])
    store.set_aside(refs[0])
    assert set(catalog.of(refs[:2])) == {refs[1]}


def test_what_is_kept_is_for_the_owner_alone(store, refs, tmp_path):
    listed(store, tmp_path)
    assert stat.S_IMODE((tmp_path / FILE).stat().st_mode) == 0o600


def test_a_folder_in_which_nothing_can_be_kept_is_enough(store, refs, tmp_path):
    assert set(listed(store, tmp_path / "nowhere")) == set(refs)


def test_what_is_kept_of_one_store_says_nothing_of_another(store, refs, tmp_path):
    listed(store, tmp_path)
    elsewhere = ArtifactStore(tmp_path / "elsewhere")
    shutil.copytree(store.cache / str(refs[1]), elsewhere.cache / str(refs[1]))
    path = elsewhere.cache / str(refs[1]) / MANIFEST_NAME
    before = (store.cache / str(refs[1]) / MANIFEST_NAME).stat()
    path.write_text(path.read_text().replace("made by", "made at"))
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert "is damaged" in listed(elsewhere, tmp_path)[refs[1]]


@pytest.mark.parametrize("text", ["", "[]", "nonsense", '{"store": "STORE", "entries": [ENTRY]}'])
def test_a_file_that_was_altered_is_passed_over(store, refs, tmp_path, text):
    listed(store, tmp_path)
    kept = json.loads((tmp_path / FILE).read_text())
    entry = json.dumps(kept["entries"][0] | {"finished": "yesterday"})
    (tmp_path / FILE).write_text(text.replace("STORE", kept["store"]).replace("ENTRY", entry))
    assert set(listed(store, tmp_path)) == set(refs)


def test_what_was_known_of_an_artifact_that_changed_is_not_shown_until_it_is_read_again(
    store, refs, tmp_path, monkeypatch
):
    catalog = Catalog(store, tmp_path)
    catalog.whole()
    path = store.cache / str(refs[1]) / MANIFEST_NAME
    path.write_text(path.read_text()[:50])
    may_read, read = threading.Event(), ArtifactStore.manifest

    def waiting(self, ref):
        may_read.wait()
        return read(self, ref)

    monkeypatch.setattr(ArtifactStore, "manifest", waiting)
    monkeypatch.setattr("juicer.artifacts.catalog.PATIENCE_SECONDS", 0.0)
    contents = catalog.contents()
    assert (set(contents.by_ref), contents.unread) == ({refs[0], refs[2]}, 1)
    may_read.set()
    assert "is damaged" in catalog.whole().by_ref[refs[1]].trouble


def test_what_killed_processes_left_of_a_list_does_not_pile_up(store, refs, tmp_path):
    for ref in refs:
        code = f"""
import os, signal
from pathlib import Path
from juicer.artifacts.catalog import Catalog
from juicer.artifacts.store import ArtifactStore
Path.replace = lambda *_: os.kill(os.getpid(), signal.SIGKILL)
Catalog(ArtifactStore({store.url!r}), Path({str(tmp_path)!r})).whole({ref.kind!r})
"""
        assert subprocess.run([sys.executable, "-c", code], check=False).returncode == -signal.SIGKILL
    assert len(list(tmp_path.glob("*draft"))) == 1
    listed(store, tmp_path)
    assert not list(tmp_path.glob("*draft"))
    assert (tmp_path / FILE).exists()
