"""What a store holds, a line an artifact, kept in memory: a manifest is read and checked once, not for every page."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import datetime
from functools import lru_cache
from typing import Self

from juicer.artifacts.manifest import Manifest
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.errors import ArtifactError, ArtifactNotFound

PATIENCE_SECONDS = 1.0
"""How long a page waits for manifests that were never read, of which a large store has more than it can wait for."""


@dataclass(frozen=True)
class Entry:
    """An artifact in a list.

    Attributes:
        ref: The artifact.
        stage: What made it; empty if it is damaged.
        tasks: Assembly tasks that it concerns.
        finished: When it was made; None if it is damaged.
        bytes: Its size.
        headline: What is worth saying of it on one line.
        parents: What it was made from.
        trouble: Why nothing is known of it, in a sentence; empty if it is whole as far as its manifest goes.
    """

    ref: ArtifactRef
    stage: str = ""
    tasks: tuple[str, ...] = ()
    finished: datetime | None = None
    bytes: int = 0
    headline: str = ""
    parents: tuple[ArtifactRef, ...] = ()
    trouble: str = ""

    @classmethod
    def of(cls, manifest: Manifest) -> Self:
        """What a list shows of an artifact."""
        recipe = manifest.recipe
        return cls(
            ref=manifest.ref,
            stage=recipe.stage,
            tasks=tuple(sorted(recipe.tasks)),
            finished=datetime.fromisoformat(manifest.finished),
            bytes=sum(file.bytes for file in manifest.files),
            headline=manifest.headline,
            parents=recipe.parents,
        )

    def answers_to(self, kind: str, stage: str, task: str, text: str) -> bool:
        """Whether it is among those that a filter asks for; an empty word asks for nothing."""
        told = f"{self.ref} {self.stage} {' '.join(self.tasks)} {self.headline} {self.trouble}".lower()
        return (
            kind in ("", self.ref.kind)
            and stage in ("", self.stage)
            and (not task or task in self.tasks)
            and all(word in told for word in text.lower().split())
        )


@dataclass(frozen=True)
class Contents:
    """What is known of a store at this moment.

    Attributes:
        entries: Artifacts, the newest first; damaged ones before all others.
        unread: Artifacts whose manifests are still being read.
        unseen: Where there may be more that cannot be looked at, a clause each.
    """

    entries: tuple[Entry, ...]
    unread: int = 0
    unseen: tuple[str, ...] = ()

    @property
    def by_ref(self) -> Mapping[ArtifactRef, Entry]:
        """The same by their names."""
        return {entry.ref: entry for entry in self.entries}

    def children(self) -> dict[ArtifactRef, list[ArtifactRef]]:
        """What was made from each artifact, oldest first."""
        children: dict[ArtifactRef, list[ArtifactRef]] = {}
        for entry in reversed(self.entries):
            for parent in entry.parents:
                children.setdefault(parent, []).append(entry.ref)
        return children


class Catalog:
    """Entries of a store's artifacts.

    What an artifact is does not change, so an entry stays true until the artifact is gone. A damaged one is looked at
    anew each time, as it may have been repaired.
    """

    def __init__(self, store: ArtifactStore) -> None:
        """Know nothing yet."""
        self._store = store
        self._entries: dict[ArtifactRef, Entry] = {}
        self._lock = threading.Lock()
        self._reading: threading.Thread | None = None

    def contents(self) -> Contents:
        """What is there; waits for manifests that are new, but not for thousands of them."""
        listing = self._store.survey()
        with self._lock:
            unread = [ref for ref in listing.refs if ref not in self._entries or self._entries[ref].trouble]
            if unread and (self._reading is None or not self._reading.is_alive()):
                self._reading = threading.Thread(target=self._read, args=(unread,), name="catalog", daemon=True)
                self._reading.start()
            reading = self._reading
        if unread and reading:
            reading.join(PATIENCE_SECONDS)
        there = set(listing.refs)
        with self._lock:
            self._entries = {ref: entry for ref, entry in self._entries.items() if ref in there}
            entries = list(self._entries.values())
        entries.sort(key=_age, reverse=True)
        return Contents(tuple(entries), len(there) - len(entries), listing.unseen)

    def _read(self, refs: Iterable[ArtifactRef]) -> None:
        for ref in refs:
            try:
                entry = Entry.of(self._store.manifest(ref))
            except ArtifactNotFound:
                continue  # it was set aside in the meantime
            except ArtifactError as error:
                entry = Entry(ref, trouble=str(error))
            with self._lock:
                self._entries[ref] = entry


@lru_cache(maxsize=4)
def catalog_of(store: ArtifactStore) -> Catalog:
    """The one catalog of a store in this process."""
    return Catalog(store)


def _age(entry: Entry) -> tuple[bool, float, ArtifactRef]:
    return (entry.finished is None, entry.finished.timestamp() if entry.finished else 0.0, entry.ref)
