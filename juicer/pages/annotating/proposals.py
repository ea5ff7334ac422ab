"""Critical states that were proposed for an artifact of episodes, or are searched for now."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from juicer.annotation.annotate import annotate
from juicer.annotation.propose import AnnotationConfig
from juicer.annotation.versions import Key
from juicer.artifacts.catalog import catalog_of
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.progress import Progress
from juicer.storage.annotations import Annotation, read_annotations
from juicer.storage.episodes import EpisodeReader

Proposals = Mapping[Key, Annotation]


def find_proposals(
    store: ArtifactStore, folder: Path, ref: ArtifactRef, reader: EpisodeReader, workers: int, progress: Progress
) -> Proposals:
    """Proposals by episode and critical state: those of the newest annotations of the episodes, else new ones.

    Args:
        store: Where the artifacts are.
        folder: Where the catalog of the store is kept.
        ref: The episodes.
        reader: The same.
        workers: Threads that may search.
        progress: Called for every episode that was searched.

    Raises:
        ArtifactError: If the annotations are damaged.
    """
    about = (
        entry.ref
        for entry in catalog_of(store, folder).whole("annotations").entries
        if entry.inputs.get("episodes") == (ref,)
    )
    # Where people labelled some, nothing was proposed for these.
    if newest := next((each for each in about if not store.recipe(each).files), None):
        return _by_key(read_annotations(store.open(newest, "annotations")))
    return _by_key(annotate(reader, AnnotationConfig(), num_workers=workers, progress=progress))


def _by_key(rows: Iterable[Annotation]) -> Proposals:
    return {(row.episode_id, row.critical_state): row for row in rows}
