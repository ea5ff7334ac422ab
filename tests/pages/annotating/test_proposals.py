"""Proposals that are there already are found without reading the manifest of everything that was ever annotated."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from juicer.artifacts.catalog import catalog_of
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.store import ArtifactStore
from juicer.pages.annotating.proposals import find_proposals
from juicer.progress import silent_progress
from juicer.storage.episodes import EpisodeReader
from tests.pages.annotating.conftest import RIGHT_STEP


def test_only_annotations_of_the_episodes_are_read_again_and_labelled_ones_passed_over(
    fill, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    ref = fill([0, 3])
    folder = tmp_path / "data"
    store = ArtifactStore(folder)
    (proposed,) = store.refs("annotations")
    with store.create(Recipe("ingest", "episodes", config={"task": "lamp"})) as other:
        pass
    with store.create(Recipe("annotate", "annotations", inputs={"episodes": (other.ref,)})):
        pass
    of_people = replace(store.recipe(proposed), files={"labels.csv": "0"})
    with store.create(of_people):
        pass
    catalog_of(store, folder).whole()
    read, manifest = [], ArtifactStore.manifest
    monkeypatch.setattr(ArtifactStore, "manifest", lambda self, each: read.append(each) or manifest(self, each))
    reader = EpisodeReader(store.open(ref, "episodes"))
    found = find_proposals(store, folder, ref, reader, 1, silent_progress)
    assert [row.step for row in found.values()] == [RIGHT_STEP, RIGHT_STEP + 3]
    assert read == [of_people.ref, proposed]
