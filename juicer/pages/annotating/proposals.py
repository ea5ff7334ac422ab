"""Critical states that were proposed for an artifact of episodes, or are searched for now."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
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


class Search:
    """A search for proposals in the background, begun again when it failed. Any thread may ask for what it finds.

    Attributes:
        searched: How many demonstrations have been searched.
    """

    _one_at_a_time = threading.Lock()

    def __init__(self, propose: Callable[[Progress], Proposals]) -> None:
        """Begin."""
        self.searched = 0
        self._propose = propose
        self._lock = threading.Lock()
        self._found = self._begin()

    def proposals(self, patience_s: float = 0.0) -> Proposals | None:
        """Proposals by episode and critical state; None while they are looked for.

        Args:
            patience_s: How long to wait for them.

        Raises:
            ArtifactError: If what was proposed before is damaged. The next call looks again: it may be repaired.
        """
        with self._lock:
            found = self._found
            if found.done() and found.exception():
                self._found = self._begin()
        try:
            return found.result(patience_s)
        except TimeoutError:
            return None

    def _begin(self) -> Future[Proposals]:
        thread = ThreadPoolExecutor(1, "proposals")
        found = thread.submit(self._run)
        thread.shutdown(wait=False)
        return found

    def _run(self) -> Proposals:
        # Each takes all processors that pages may keep busy.
        with self._one_at_a_time:
            return self._propose(self._progress)

    def _progress(self, done: int, total: int, **facts: float | str) -> None:
        self.searched = done


def _by_key(rows: Iterable[Annotation]) -> Proposals:
    return {(row.episode_id, row.critical_state): row for row in rows}
