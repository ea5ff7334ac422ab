"""Artifacts in a remote store (S3 or whatever fsspec can reach), made and read through a local cache.

``<url>/<kind>/<id>/manifest.json`` is written last, and overwritten only where an artifact is to be replaced; it
makes the artifact exist. The files lie in ``<url>/<kind>/<id>/<content>/``, named by what they hold, so that two
machines which finish one id at the same time cannot mix their files.
"""

from __future__ import annotations

import errno
import logging
import uuid
from collections.abc import Collection, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import compress
from pathlib import Path
from typing import Any

import fsspec

from juicer.artifacts.backend import ASIDE, next_room, read_manifest, salvage_manifest
from juicer.artifacts.findings import (
    Finding,
    Listing,
    Nature,
    TroubleError,
    damaged,
    is_as_written,
    raise_worst,
)
from juicer.artifacts.integrity import describe_extra, find_problems, wrong_size
from juicer.artifacts.local import LocalBackend
from juicer.artifacts.manifest import MANIFEST_NAME, MOST_BYTES, FileEntry, Manifest
from juicer.artifacts.ref import ArtifactRef, is_id
from juicer.artifacts.workspace import Workspace, delete_tree
from juicer.artifacts.writing import is_of_disk
from juicer.errors import ArtifactError, ConfigError, StoreNotWritable, StoreUnreachable
from juicer.text import printable

logger = logging.getLogger(__name__)

_REQUESTS = 16
"""That wait for a store at a time."""


@dataclass(frozen=True)
class RemoteBackend:
    """Objects below one URL, which decide what exists, and a local folder with verified copies."""

    url: str
    cache: LocalBackend

    @property
    def work(self) -> Workspace:
        """Hidden folders in the cache."""
        return self.cache.work

    def is_there(self) -> bool:
        """Whether there is an object below the address."""
        with self._talking(ArtifactError, "read"):
            return bool(self._fs.exists(self._base))

    def survey(self, kinds: Iterable[str], beginning: str = "") -> Listing:
        """Every artifact of the kinds whose id begins so; objects under other names are not juicer's business."""
        with self._talking(ArtifactError, "read"):
            found = ((kind, name) for kind in kinds for name in self._names(f"{self._base}/{kind}"))
            refs = [ArtifactRef(kind, name) for kind, name in found if name.startswith(beginning) and is_id(name)]
            fs, paths = self._fs, [self._manifest_path(ref) for ref in refs]
            # Each is a request of its own. File systems that are not asynchronous have one connection for all.
            with ThreadPoolExecutor(_REQUESTS if fs.async_impl else 1) as together:
                return Listing(tuple(sorted(compress(refs, together.map(fs.exists, paths)))))

    def exists(self, ref: ArtifactRef) -> bool:
        """Whether the artifact was committed; says nothing about damage since."""
        with self._talking(ArtifactError, "read"):
            return bool(self._fs.exists(self._manifest_path(ref)))

    def address(self, ref: ArtifactRef) -> str:
        """Its URL."""
        return f"{self.url.rstrip('/')}/{ref}"

    def read(self, ref: ArtifactRef) -> bytes:
        """Manifest of a committed artifact as it was written; see :class:`~juicer.artifacts.backend.Backend`."""
        path = self._manifest_path(ref)
        with self._talking(ArtifactError, "read"):
            try:
                facts = self._fs.info(path)
                if facts["type"] != "file":
                    raise damaged(f"file '{MANIFEST_NAME}' was replaced by something else")
                if facts["size"] > MOST_BYTES:
                    raise damaged(f"file '{MANIFEST_NAME}' is unusable: it is larger than {MOST_BYTES:,} bytes")
                return bytes(self._fs.cat_file(path))
            except FileNotFoundError:
                raise damaged(f"file '{MANIFEST_NAME}' is missing") from None

    def stamp(self, ref: ArtifactRef) -> str:
        """Nothing: to ask for it takes as long as to read the manifest."""
        return ""

    def problems(self, ref: ArtifactRef) -> list[Finding]:
        """Download everything and compare it with the manifest; a damaged copy in the cache goes aside."""
        with self.work.lock(ref.id):
            if any(finding.nature is Nature.DAMAGE for finding in self._problems_of_copy(ref)):
                self.cache.set_aside(ref)
            return self._inspect(ref)

    def open(self, ref: ArtifactRef, read: Collection[str] | None = None) -> Path:
        """Cached copy, downloaded unless it is there and whole; see :class:`~juicer.artifacts.backend.Backend`."""
        manifest = read_manifest(self, ref)
        if not self._is_cached(manifest, read):
            with self.work.lock(ref.id):
                # Another process may have downloaded it while this one waited.
                if not self._is_cached(manifest, read):
                    self._cache(manifest)
        return self.cache.folder(ref)

    def recover(self, ref: ArtifactRef) -> bool:
        """Upload a finished artifact of the cache whose upload was cut short."""
        if self.exists(ref):
            return True
        if not self.cache.recover(ref):
            return False
        if not _is_usable(self.cache.problems(ref)):
            self.cache.set_aside(ref)
            return False
        self._publish(read_manifest(self.cache, ref))
        return True

    def mend(self, ref: ArtifactRef) -> bool:
        """Upload the cached copy again if it is whole; or write the manifest anew, whose content may be."""
        try:
            content = self.read(ref)
        except TroubleError:
            content = b""
        manifest = salvage_manifest(content, ref)
        if self.cache.exists(ref) and _is_usable(self.cache.problems(ref)):
            cached = read_manifest(self.cache, ref)
            if manifest in (None, cached):
                self._replace(cached)
                return True
        if manifest is None or manifest.to_text().encode() == content:
            return False
        with self._talking(StoreNotWritable, "written"):
            self._fs.pipe_file(f"{self._room_aside(ref)}/{MANIFEST_NAME}", content)
            self._fs.pipe_file(self._manifest_path(ref), manifest.to_text().encode())
        return True

    def sweep(self) -> None:
        """Clear away what dead processes left in the cache."""
        self.cache.sweep()

    def check_writable(self, ref: ArtifactRef) -> None:
        """Write and delete a small object, and try the cache."""
        self.cache.check_writable(ref)
        probe = f"{self._base}/.work/{uuid.uuid4().hex}"
        with self._talking(StoreNotWritable, "written"):
            self._fs.pipe_file(probe, b"")
            self._fs.rm_file(probe)

    def commit(self, draft: Path, manifest: Manifest, *, replacing: bool = False) -> None:
        """Publish a draft in the cache, then upload it; a failed upload of a new one is repeated by :meth:`recover`."""
        self.cache.commit(draft, manifest)
        if replacing:
            self._replace(manifest)
        else:
            self._publish(manifest)

    def set_aside(self, ref: ArtifactRef) -> str:
        """Copy all objects of an artifact, then delete the manifest, then the rest; the cached copy goes aside too."""
        with self._talking(StoreNotWritable, "written"):
            paths = self._fs.find(self._folder(ref))
            aside = self._copy_aside(ref, paths)
            for path in sorted(paths, key=lambda path: path != self._manifest_path(ref)):
                self._fs.rm_file(path)
        if self.cache.exists(ref):
            self.cache.set_aside(ref)
        return aside

    def asides(self, ref: ArtifactRef) -> list[str]:
        """What was set aside of an artifact, oldest first."""
        with self._talking(ArtifactError, "read"):
            names = self._names(f"{self._base}/{ASIDE}/{ref}")
        return [self._aside_address(ref, name) for name in sorted(names, key=lambda name: (len(name), name))]

    def _copy_aside(self, ref: ArtifactRef, paths: Sequence[str]) -> str:
        room = self._room_aside(ref)
        for path in paths:
            self._fs.cp_file(path, f"{room}/{path.removeprefix(self._folder(ref)).lstrip('/')}")
        return self._aside_address(ref, room.rpartition("/")[2])

    def _room_aside(self, ref: ArtifactRef) -> str:
        """Where nothing was set aside before."""
        return f"{self._base}/{ASIDE}/{ref}/{next_room(self._names(f'{self._base}/{ASIDE}/{ref}'))}"

    def _aside_address(self, ref: ArtifactRef, name: str) -> str:
        return f"{self.url.rstrip('/')}/{ASIDE}/{ref}/{name}"

    def _names(self, folder: str) -> list[str]:
        """What lies directly below a path. A glob would take a refusal for an empty folder."""
        try:
            paths = self._fs.ls(folder, detail=False)
        except FileNotFoundError:
            return []
        return sorted({str(path).rstrip("/").rpartition("/")[2] for path in paths})

    def _publish(self, manifest: Manifest) -> None:
        source, target = self.cache.folder(manifest.ref), self._payload(manifest)
        with self._talking(StoreNotWritable, "written"):
            self._fs.put(*_pairs(source, target, manifest.files))
            try:
                path = self._manifest_path(manifest.ref)
                self._fs.pipe_file(path, manifest.to_text().encode(), mode="create")
                return
            except FileExistsError:
                logger.info("another machine finished %s first; its files are kept", manifest.ref)
            if read_manifest(self, manifest.ref).content != manifest.content:
                self._fs.rm(target, recursive=True)

    def _replace(self, manifest: Manifest) -> None:
        """Upload an artifact in the place of another: its files, its manifest; what is left of the other goes last."""
        source, target, ref = self.cache.folder(manifest.ref), self._payload(manifest), manifest.ref
        kept = {MANIFEST_NAME, *(f"{manifest.content}/{entry.path}" for entry in manifest.files)}
        is_whole = is_as_written(self._inspect(ref))
        with self._talking(StoreNotWritable, "written"):
            before = self._fs.find(self._folder(ref))
            if not is_whole and before:
                aside = self._copy_aside(ref, before)
                logger.warning("what lay in the place of %s was not as it was written; it is kept in '%s'", ref, aside)
            self._fs.put(*_pairs(source, target, manifest.files))
            self._fs.pipe_file(self._manifest_path(ref), manifest.to_text().encode())
            if stale := [path for path in before if path.rpartition(f"{ref}/")[2] not in kept]:
                self._fs.rm(stale)

    def _inspect(self, ref: ArtifactRef) -> list[Finding]:
        """See :meth:`problems`; needs the lock."""
        try:
            return self._download(read_manifest(self, ref))
        except TroubleError as trouble:
            return [trouble.finding]
        finally:
            delete_tree(self.work.draft(ref.id))

    def _problems_of_copy(self, ref: ArtifactRef) -> list[Finding]:
        return self.cache.problems(ref) if self.cache.exists(ref) else []

    def _is_cached(self, manifest: Manifest, read: Collection[str] | None) -> bool:
        """Whether the cache holds this very artifact: a repaired one has the same id but another manifest."""
        ref = manifest.ref
        return (
            self.cache.exists(ref)
            and is_as_written(self.cache.obstacles(ref, read))
            and read_manifest(self.cache, ref) == manifest
        )

    def _cache(self, manifest: Manifest) -> None:
        draft = self.work.draft(manifest.ref.id)
        try:
            raise_worst(self._download(manifest))
        except TroubleError:
            delete_tree(draft)
            raise
        self.cache.commit(draft, manifest)

    def _download(self, manifest: Manifest) -> list[Finding]:
        """Fetch the files into the draft folder of the id; gives how they differ from the manifest."""
        draft, payload = self.work.draft(manifest.ref.id), self._payload(manifest)
        delete_tree(draft)
        draft.mkdir(parents=True)
        with self._talking(ArtifactError, "read"):
            found = self._fs.find(payload, detail=True)
            sizes = {path.rpartition(f"{manifest.content}/")[2]: info["size"] for path, info in found.items()}
            # Nobody knows how large an object is that is not what was written.
            altered = [entry for entry in manifest.files if sizes.get(entry.path, entry.bytes) != entry.bytes]
            expected = [entry for entry in manifest.files if sizes.get(entry.path, entry.bytes) == entry.bytes]
            local, remote = _pairs(draft, payload, [entry for entry in expected if entry.path in sizes])
            self._fs.get(remote, local)
        extra = set(sizes).difference(entry.path for entry in manifest.files)
        return [
            *(wrong_size(entry, sizes[entry.path]) for entry in altered),
            *find_problems(draft, expected),
            *(describe_extra(path) for path in sorted(extra)),
        ]

    @property
    def _fs(self) -> Any:
        return self._reach()[0]

    @property
    def _base(self) -> str:
        return self._reach()[1]

    def _reach(self) -> tuple[Any, str]:
        try:
            # fsspec keeps one instance for each set of arguments. Its listings must not outlive a call:
            # other machines write to the store too.
            fs, base = fsspec.core.url_to_fs(self.url, use_listings_cache=False)
        except (ImportError, ValueError) as error:
            raise ConfigError(f"artifact store '{self.url}' cannot be used: {error}") from None
        return fs, str(base).rstrip("/")

    def _folder(self, ref: ArtifactRef) -> str:
        return f"{self._base}/{ref.kind}/{ref.id}"

    def _manifest_path(self, ref: ArtifactRef) -> str:
        return f"{self._folder(ref)}/{MANIFEST_NAME}"

    def _payload(self, manifest: Manifest) -> str:
        return f"{self._folder(manifest.ref)}/{manifest.content}"

    @contextmanager
    def _talking(self, error_type: type[ArtifactError], verb: str) -> Iterator[None]:
        try:
            yield
        except (ArtifactError, ConfigError, TroubleError):
            raise
        # Each protocol brings its own exceptions, with no common base: refused, unreachable, timed out.
        except Exception as error:
            if is_of_disk(error, self.cache.root):
                raise
            reason = printable(" ".join(str(error).split())) or type(error).__name__
            sentence = f"the artifact store '{self.url}' cannot be {verb}: {reason}"
            error_type = StoreUnreachable if _is_away(error) else error_type
            raise error_type(f"{sentence}; check its address, credentials and network") from error


def _is_away(error: BaseException | None) -> bool:
    """Whether nobody answered, or somebody who was too busy to; each protocol says so in classes of its own."""
    while error is not None:
        names = [each.__name__ for each in type(error).__mro__]
        if any(name.endswith("ConnectionError") or "Timeout" in name for name in names):
            return True
        if isinstance(error, OSError) and error.errno in (errno.EBUSY, errno.EREMOTEIO):  # as s3fs tells HTTP 503, 500
            return True
        error = error.__cause__ or error.__context__
    return False


def _is_usable(findings: Sequence[Finding]) -> bool:
    """Whether all files that belong to an artifact are as written; others do not matter to an upload."""
    return all(finding.nature in (Nature.STRAY, Nature.LITTER) for finding in findings)


def _pairs(folder: Path, prefix: str, entries: Sequence[FileEntry]) -> tuple[list[str], list[str]]:
    """Local and remote paths of the files, in step."""
    return [str(folder / entry.path) for entry in entries], [f"{prefix}/{entry.path}" for entry in entries]
