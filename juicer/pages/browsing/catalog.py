"""What a store holds, a line an artifact: a manifest is read and checked once, not for every page.

To check ten thousand takes a minute. The newest come first, pages show what is known by then, and the lines are kept in
a file for the next start.
"""

from __future__ import annotations

import logging
import os
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import lru_cache
from pathlib import Path
from typing import Self

from pydantic import TypeAdapter

from juicer.artifacts.manifest import Manifest
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.errors import ArtifactError, ArtifactNotFound
from juicer.reading import read_bounded

PATIENCE_SECONDS = 1.0
"""How long a page waits for manifests that were never read, of which a large store has more than it can wait for."""
FILE = ".pages-catalog.json"
MOST_BYTES = 2**28

logger = logging.getLogger(__name__)


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

    def __init__(self, store: ArtifactStore, folder: Path) -> None:
        """Know what an earlier one wrote into a folder, which may be nothing."""
        self._store = store
        self._file = folder / FILE
        self._entries = _kept(self._file)
        self._lock = threading.Lock()
        self._reading: threading.Thread | None = None

    def contents(self) -> Contents:
        """What is there; waits for manifests that are new, but not for thousands of them."""
        listing = self._store.survey()
        with self._lock:
            unread = [ref for ref in listing.refs if ref not in self._entries or self._entries[ref].trouble]
            if unread and (self._reading is None or not self._reading.is_alive()):
                self._reading = threading.Thread(
                    target=self._read, args=(frozenset(unread),), name="catalog", daemon=True
                )
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

    def _read(self, refs: frozenset[ArtifactRef]) -> None:
        for ref in sorted(refs, key=self._changed, reverse=True):
            try:
                entry = Entry.of(self._store.manifest(ref))
            except ArtifactNotFound:
                continue  # it was set aside in the meantime
            except ArtifactError as error:
                entry = Entry(ref, trouble=str(error))
            with self._lock:
                self._entries[ref] = entry
        with self._lock:
            whole = [entry for entry in self._entries.values() if not entry.trouble]
            is_news = any(entry.ref in refs for entry in whole)
        if is_news:
            _keep(self._file, whole)

    def _changed(self, ref: ArtifactRef) -> float:
        """When an artifact on this machine's disk was made, without reading it; 0 if that cannot be told."""
        try:
            return (Path(self._store.url) / ref.kind / ref.id).stat().st_mtime
        except OSError:
            return 0.0


@lru_cache(maxsize=4)
def catalog_of(store: ArtifactStore, folder: Path) -> Catalog:
    """The one catalog of a store in this process."""
    return Catalog(store, folder)


_ENTRIES = TypeAdapter(list[Entry])


def _kept(file: Path) -> dict[ArtifactRef, Entry]:
    try:
        return {entry.ref: entry for entry in _ENTRIES.validate_json(read_bounded(file, MOST_BYTES))}
    except (OSError, ValueError):
        return {}


def _keep(file: Path, entries: Sequence[Entry]) -> None:
    draft = file.with_name(f"{file.name}.{os.getpid()}.draft")
    try:
        draft.write_bytes(_ENTRIES.dump_json(list(entries)))
        draft.replace(file)
    except OSError as error:
        # It only saves time.
        logger.debug("'%s' cannot be written: %s", file, error)
        draft.unlink(missing_ok=True)


def _age(entry: Entry) -> tuple[bool, float, ArtifactRef]:
    return (entry.finished is None, entry.finished.timestamp() if entry.finished else 0.0, entry.ref)
