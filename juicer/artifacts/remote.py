"""Artifacts in a remote store (S3 or whatever fsspec can reach), made and read through a local cache.

``<url>/<kind>/<id>/manifest.json`` is written last, and overwritten only where an artifact is to be replaced; it
makes the artifact exist. The files lie in ``<url>/<kind>/<id>/<content>/``, named by what they hold, so that two
machines which finish one id at the same time cannot mix their files.
"""

from __future__ import annotations

import logging
import uuid
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import fsspec

from juicer.artifacts.integrity import DamageError, find_problems
from juicer.artifacts.local import LocalBackend, parse_manifest
from juicer.artifacts.manifest import MANIFEST_NAME, FileEntry, Manifest
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.workspace import Workspace, delete_tree
from juicer.errors import ArtifactError, ConfigError, StoreNotWritable

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class RemoteBackend:
    """Objects below one URL, which decide what exists, and a local folder with verified copies."""

    url: str
    cache: LocalBackend

    @property
    def work(self) -> Workspace:
        """Hidden folders in the cache."""
        return self.cache.work

    def refs(self, kinds: Iterable[str]) -> list[ArtifactRef]:
        """Every artifact of the kinds, sorted."""
        with self._talking(ArtifactError, "read"):
            paths = [path for kind in kinds for path in self._fs.glob(f"{self._base}/{kind}/*/{MANIFEST_NAME}")]
        return sorted(ArtifactRef(*path.split("/")[-3:-1]) for path in paths)

    def exists(self, ref: ArtifactRef) -> bool:
        """Whether the artifact was committed; says nothing about damage since."""
        with self._talking(ArtifactError, "read"):
            return bool(self._fs.exists(self._manifest_path(ref)))

    def read_manifest(self, ref: ArtifactRef) -> Manifest:
        """Description of a committed artifact; see :class:`~juicer.artifacts.backend.Backend`."""
        with self._talking(ArtifactError, "read"):
            try:
                content = self._fs.cat_file(self._manifest_path(ref))
            except FileNotFoundError:
                raise DamageError(f"file '{MANIFEST_NAME}' is missing") from None
        return parse_manifest(content, ref)

    def problems(self, ref: ArtifactRef) -> list[str]:
        """Download everything and compare it with the manifest."""
        with self.work.lock(ref.id):
            try:
                manifest = self.read_manifest(ref)
                return self._download(manifest)
            except DamageError as damage:
                return [str(damage)]
            finally:
                delete_tree(self.work.draft(ref.id))

    def open(self, ref: ArtifactRef) -> Path:
        """Cached copy, downloaded unless it is there and whole; see :class:`~juicer.artifacts.backend.Backend`."""
        manifest = self.read_manifest(ref)
        if not self._is_cached(manifest):
            with self.work.lock(ref.id):
                # Another process may have downloaded it while this one waited.
                if not self._is_cached(manifest):
                    self._cache(manifest)
        return self.cache.folder(ref)

    def recover(self, ref: ArtifactRef) -> bool:
        """Upload a finished artifact of the cache whose upload was cut short."""
        if self.exists(ref):
            return True
        if not self.cache.exists(ref):
            return False
        if self.cache.problems(ref):
            self.cache.remove(ref)
            return False
        self._publish(self.cache.read_manifest(ref))
        return True

    def check_writable(self) -> None:
        """Write and delete a small object."""
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

    def remove(self, ref: ArtifactRef) -> None:
        """Delete the manifest, then the files, then the cached copy."""
        with self._talking(StoreNotWritable, "written"):
            for path in (self._manifest_path(ref), self._folder(ref)):
                if self._fs.exists(path):
                    self._fs.rm(path, recursive=True)
        if self.cache.exists(ref):
            self.cache.remove(ref)

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
            if self.read_manifest(manifest.ref).content != manifest.content:
                self._fs.rm(target, recursive=True)

    def _replace(self, manifest: Manifest) -> None:
        """Upload an artifact in the place of another: its files, its manifest; what is left of the other goes last."""
        source, target, ref = self.cache.folder(manifest.ref), self._payload(manifest), manifest.ref
        kept = {MANIFEST_NAME, *(f"{manifest.content}/{entry.path}" for entry in manifest.files)}
        with self._talking(StoreNotWritable, "written"):
            before = self._fs.find(self._folder(ref))
            self._fs.put(*_pairs(source, target, manifest.files))
            self._fs.pipe_file(self._manifest_path(ref), manifest.to_text().encode())
            if stale := [path for path in before if path.rpartition(f"{ref}/")[2] not in kept]:
                self._fs.rm(stale)

    def _is_cached(self, manifest: Manifest) -> bool:
        """Whether the cache holds this very artifact: a repaired one has the same id but another manifest."""
        ref = manifest.ref
        return self.cache.exists(ref) and not self.cache.problems(ref) and self.cache.read_manifest(ref) == manifest

    def _cache(self, manifest: Manifest) -> None:
        draft = self.work.draft(manifest.ref.id)
        if problems := self._download(manifest):
            delete_tree(draft)
            raise DamageError(problems[0])
        self.cache.commit(draft, manifest)

    def _download(self, manifest: Manifest) -> list[str]:
        """Fetch the files into the draft folder of the id; gives how they differ from the manifest."""
        draft, payload = self.work.draft(manifest.ref.id), self._payload(manifest)
        delete_tree(draft)
        draft.mkdir(parents=True)
        with self._talking(ArtifactError, "read"):
            present = {path.rpartition(f"{manifest.content}/")[2] for path in self._fs.find(payload)}
            wanted = [entry for entry in manifest.files if entry.path in present]
            local, remote = _pairs(draft, payload, wanted)
            self._fs.get(remote, local)
        extra = present.difference(entry.path for entry in manifest.files)
        problems = find_problems(draft, manifest.files)
        return problems + [f"file '{path}' does not belong to it" for path in sorted(extra)]

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
        except (ArtifactError, ConfigError, DamageError):
            raise
        # Each protocol brings its own exceptions, with no common base: refused, unreachable, timed out.
        except Exception as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            sentence = f"the artifact store '{self.url}' cannot be {verb}: {reason}"
            raise error_type(f"{sentence}; check its address, credentials and network") from error


def _pairs(folder: Path, prefix: str, entries: Sequence[FileEntry]) -> tuple[list[str], list[str]]:
    """Local and remote paths of the files, in step."""
    return [str(folder / entry.path) for entry in entries], [f"{prefix}/{entry.path}" for entry in entries]
