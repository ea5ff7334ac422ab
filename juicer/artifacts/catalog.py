"""What a store holds, a line an artifact: a manifest is read and checked once, not for every list.

To check ten thousand takes half a minute. The lines are kept in a file, and a manifest is read again only if it was
written since. A list says what artifacts say of themselves; whether their files are whole is asked when one is opened,
and by `juicer verify`.
"""

from __future__ import annotations

import hashlib
import logging
import threading
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, Self

from filelock import FileLock, Timeout
from pydantic import TypeAdapter

from juicer.artifacts.findings import Listing
from juicer.artifacts.manifest import Manifest, headline_of
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.config import canonical_json
from juicer.errors import ArtifactError, ArtifactNotFound
from juicer.reading import read_bounded

PATIENCE_SECONDS = 1.0
"""How long a page waits for manifests that were never read, of which a large store has more than it can wait for."""
FILE = ".catalog.json"
MOST_BYTES = 2**28
_PRIVATE = 0o600
"""What the file tells is not for whoever may not read the artifacts."""

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Entry:
    """An artifact in a list.

    Attributes:
        ref: The artifact.
        stage: What made it; empty if it is damaged.
        work: What tells making it from other work, see :func:`kind_of_work`; empty if it is damaged.
        tasks: Assembly tasks that it concerns.
        finished: When it was made, ISO 8601; empty if it is damaged.
        seconds: How long that took.
        bytes: Its size.
        inputs: What it was made from, by role.
        summary: What it says of itself.
        trouble: Why nothing is known of it, in a sentence; empty if it is whole as far as its manifest goes.
        stamp: What tells its manifest from one that is written later, see :meth:`ArtifactStore.stamp`.
    """

    ref: ArtifactRef
    stage: str = ""
    work: str = ""
    tasks: tuple[str, ...] = ()
    finished: str = ""
    seconds: float = 0.0
    bytes: int = 0
    inputs: Mapping[str, tuple[ArtifactRef, ...]] = field(default_factory=dict)
    summary: Mapping[str, Any] = field(default_factory=dict)
    trouble: str = ""
    stamp: str = ""

    @classmethod
    def of(cls, manifest: Manifest, stamp: str = "") -> Self:
        """What a list shows of an artifact."""
        recipe = manifest.recipe
        return cls(
            ref=manifest.ref,
            stage=recipe.stage,
            work=kind_of_work(recipe),
            tasks=tuple(sorted(recipe.tasks)),
            finished=manifest.finished,
            seconds=manifest.seconds,
            bytes=sum(file.bytes for file in manifest.files),
            inputs=recipe.inputs,
            summary=manifest.summary,
            stamp=stamp,
        )

    @cached_property
    def headline(self) -> str:
        """What is worth saying of it on one line."""
        return headline_of(self.summary)

    @cached_property
    def moment(self) -> datetime | None:
        """When it was made; None if it is damaged."""
        return datetime.fromisoformat(self.finished) if self.finished else None

    @property
    def parents(self) -> tuple[ArtifactRef, ...]:
        """What it was made from, each once."""
        return tuple(dict.fromkeys(ref for refs in self.inputs.values() for ref in refs))

    def answers_to(self, kind: str, stage: str, task: str, text: str) -> bool:
        """Whether it is among those that a filter asks for; an empty word asks for nothing."""
        return (
            kind in ("", self.ref.kind)
            and stage in ("", self.stage)
            and (not task or task in self.tasks)
            and (not text or all(word in self._told for word in text.lower().split()))
        )

    @cached_property
    def _told(self) -> str:
        return f"{self.ref} {self.stage} {' '.join(self.tasks)} {self.headline} {self.trouble}".lower()


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

    @cached_property
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

    What an artifact is does not change, so an entry stays true until its manifest is written again or is gone. A
    damaged one is looked at anew each time, as it may have been repaired.
    """

    def __init__(self, store: ArtifactStore, folder: Path) -> None:
        """Know what an earlier one wrote into a folder, which may be nothing."""
        self._store = store
        self._file = folder / FILE
        self._entries = _kept(self._file, store.url)
        self._lock = threading.Lock()
        self._reading: threading.Thread | None = None

    def contents(self) -> Contents:
        """What is there; waits for manifests that are new, but not for thousands of them."""
        listing = self._store.survey()
        if unread := self._unread(listing.refs):
            with self._lock:
                if self._reading is None or not self._reading.is_alive():
                    self._reading = threading.Thread(target=self._read, args=(unread,), name="catalog", daemon=True)
                    self._reading.start()
                reading = self._reading
            reading.join(PATIENCE_SECONDS)
        return self._contents(listing)

    def whole(self, kind: str | None = None, *, trusts_unstamped: bool = False) -> Contents:
        """All that is there, of one kind or of all, however long the reading takes.

        Args:
            kind: Which; all if None.
            trusts_unstamped: Whether what was known before will do where only a reading can tell if it has changed.
        """
        listing = self._store.survey(kind)
        self._read(self._unread(listing.refs, trusts_unstamped=trusts_unstamped))
        return self._contents(listing)

    def of(self, refs: Collection[ArtifactRef]) -> Mapping[ArtifactRef, Entry]:
        """Entries of these artifacts; of one that is not there, none."""
        self._read(self._unread(refs, trusts_unstamped=False))
        with self._lock:
            return {ref: self._entries[ref] for ref in refs if ref in self._entries}

    def _unread(self, refs: Iterable[ArtifactRef], *, trusts_unstamped: bool = True) -> Sequence[ArtifactRef]:
        """Those of which nothing is known, or what is known may be older than their manifests.

        What was known of one that was written since is forgotten, so that no list shows it meanwhile.
        """

        def is_known(ref: ArtifactRef) -> bool:
            entry, stamp = self._entries.get(ref), self._store.stamp(ref)
            if entry is None:
                return False
            if entry.stamp != stamp:
                with self._lock:
                    # Another thread may have read it since.
                    if self._entries.get(ref) is entry:
                        del self._entries[ref]
                return False
            return not entry.trouble and (bool(stamp) or trusts_unstamped)

        return [ref for ref in refs if not is_known(ref)]

    def _contents(self, listing: Listing) -> Contents:
        with self._lock:
            entries = [self._entries[ref] for ref in listing.refs if ref in self._entries]
        entries.sort(key=_age, reverse=True)
        return Contents(tuple(entries), len(listing.refs) - len(entries), listing.unseen)

    def _read(self, refs: Sequence[ArtifactRef]) -> None:
        has_learned = False
        for ref in sorted(refs, key=self._changed, reverse=True):
            # Before the reading: what is written during it is read again.
            stamp = self._store.stamp(ref)
            try:
                entry = Entry.of(self._store.manifest(ref), stamp)
            except ArtifactNotFound:
                # It was set aside, maybe in the meantime.
                with self._lock:
                    self._entries.pop(ref, None)
                continue
            except ArtifactError as error:
                entry = Entry(ref, trouble=str(error), stamp=stamp)
            with self._lock:
                has_learned |= not entry.trouble and self._entries.get(ref) != entry
                self._entries[ref] = entry
        if has_learned:
            self._keep()

    def _changed(self, ref: ArtifactRef) -> float:
        """When an artifact on this machine's disk was made, without reading it; 0 if that cannot be told."""
        try:
            return (Path(self._store.url) / ref.kind / ref.id).stat().st_mtime
        except OSError:
            return 0.0

    def _keep(self) -> None:
        """Write what is known of all that is still there, for whoever lists them next."""
        with self._lock:
            known = set(self._entries)
        there = set(self._store.survey().refs)
        with self._lock:
            # What was read during the survey may be newer than that.
            there |= set(self._entries) - known
            self._entries = {ref: entry for ref, entry in self._entries.items() if ref in there}
            whole = [entry for entry in self._entries.values() if not entry.trouble]
        if self._file.parent.is_dir():
            self._write(_KEPT.dump_json(_Kept(self._store.url, whole)))

    def _write(self, content: bytes) -> None:
        # One draft for all processes: the next one writes over what a dead one left.
        draft = self._file.with_name(f"{FILE}.draft")
        try:
            with FileLock(self._file.with_name(f"{FILE}.lock"), timeout=0):
                draft.touch(_PRIVATE)
                draft.write_bytes(content)
                draft.replace(self._file)
        except (OSError, Timeout) as error:
            # It only saves time.
            logger.debug("'%s' cannot be written: %s", self._file, error)


def kind_of_work(recipe: Recipe) -> str:
    """What takes about the same time: a stage with a configuration, whatever it starts from and draws."""
    content = {name: value for name, value in recipe.config.items() if name not in ("seed", "first", "rows")}
    told = f"{recipe.stage} {canonical_json(content)}"
    return hashlib.sha256(told.encode()).hexdigest()[:16]


@lru_cache(maxsize=4)
def catalog_of(store: ArtifactStore, folder: Path) -> Catalog:
    """The one catalog of a store in this process."""
    return Catalog(store, folder)


@dataclass(frozen=True)
class _Kept:
    """What a file keeps: entries of one store, as another may hold other artifacts by the same names."""

    store: str
    entries: list[Entry]


_KEPT = TypeAdapter(_Kept)


def _kept(file: Path, store: str) -> dict[ArtifactRef, Entry]:
    try:
        kept = _KEPT.validate_json(read_bounded(file, MOST_BYTES))
        if kept.store != store or not all(entry.moment and entry.work for entry in kept.entries):
            return {}
        return {entry.ref: entry for entry in kept.entries}
    except (OSError, ValueError):
        return {}


def _age(entry: Entry) -> tuple[bool, float, ArtifactRef]:
    return (entry.moment is None, entry.moment.timestamp() if entry.moment else 0.0, entry.ref)
