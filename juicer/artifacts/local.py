"""Artifacts as folders of a local file system: ``<root>/<kind>/<id>/``, work in progress in ``<root>/.work/``."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from filelock import FileLock, Timeout

from juicer.artifacts.integrity import find_problems, sync, sync_tree
from juicer.artifacts.manifest import MANIFEST_NAME, Manifest
from juicer.artifacts.ref import KINDS, ArtifactRef

_POLL_S = 0.1


@dataclass(frozen=True)
class LocalStore:
    """Folders, locks and commits below one root; an artifact is there if and only if its folder is."""

    root: Path

    def folder(self, ref: ArtifactRef) -> Path:
        """Where the artifact is, or would be."""
        return self.root / ref.kind / ref.id

    def draft(self, identity: str) -> Path:
        """Hidden folder in which the files of an unfinished artifact grow."""
        return self.root / ".work" / "drafts" / identity

    def scratch(self, identity: str) -> Path:
        """Folder for what a killed run leaves to its successor."""
        return self.root / ".work" / "scratch" / identity

    def refs(self, kind: str | None = None) -> list[ArtifactRef]:
        """Every artifact, sorted."""
        kinds = [kind] if kind else KINDS
        return sorted(
            ArtifactRef(name, path.name)
            for name in kinds
            if (self.root / name).is_dir()
            for path in (self.root / name).iterdir()
            if path.is_dir()
        )

    def exists(self, ref: ArtifactRef) -> bool:
        """Whether the artifact was committed; says nothing about damage since."""
        return self.folder(ref).is_dir()

    def read_manifest(self, ref: ArtifactRef) -> Manifest:
        """Manifest of a committed artifact.

        Raises:
            ValueError: If it is missing, unreadable, altered, or that of another artifact.
        """
        try:
            text = (self.folder(ref) / MANIFEST_NAME).read_text(encoding="utf-8")
        except FileNotFoundError:
            raise ValueError(f"file '{MANIFEST_NAME}' is missing") from None
        except (OSError, UnicodeDecodeError) as error:
            raise ValueError(f"file '{MANIFEST_NAME}' cannot be read: {error}") from None
        try:
            manifest = Manifest.from_text(text)
        except ValueError as error:
            raise ValueError(f"file '{MANIFEST_NAME}' is unusable: {error}") from None
        if manifest.ref != ref:
            raise ValueError(f"file '{MANIFEST_NAME}' is that of {manifest.ref}")
        return manifest

    def problems(self, ref: ArtifactRef) -> list[str]:
        """Every way in which a committed artifact differs from its manifest, one clause each."""
        try:
            manifest = self.read_manifest(ref)
        except ValueError as error:
            return [str(error)]
        return find_problems(self.folder(ref), manifest.files)

    def commit(self, draft: Path, manifest: Manifest) -> None:
        """Publish a draft: everything reaches the disk, and only then one rename makes it visible."""
        (draft / MANIFEST_NAME).write_text(manifest.to_text(), encoding="utf-8")
        sync_tree(draft)
        target = self.folder(manifest.ref)
        target.parent.mkdir(parents=True, exist_ok=True)
        draft.rename(target)
        sync(target.parent)
        sync(self.root)

    def remove(self, ref: ArtifactRef) -> None:
        """Take an artifact away: invisible at once, then deleted. Needs its lock."""
        grave = self.draft(ref.id)
        delete_tree(grave)
        grave.parent.mkdir(parents=True, exist_ok=True)
        self.folder(ref).rename(grave)
        delete_tree(grave)

    @contextmanager
    def lock(self, identity: str, *, wait: bool = True) -> Iterator[bool]:
        """Hold the lock of an id; gives whether it was obtained, which may be false only without ``wait``.

        The kernel drops the lock with its owner, so that no death can block an id.
        """
        path = self.root / ".work" / "locks" / f"{identity}.lock"
        path.parent.mkdir(parents=True, exist_ok=True)
        lock = FileLock(path, timeout=-1 if wait else 0)
        try:
            lock.acquire(poll_interval=_POLL_S)
        except Timeout:
            yield False
            return
        try:
            yield True
        finally:
            # Unlinked while held: a waiter that gets the old inode notices and opens the path again.
            path.unlink(missing_ok=True)
            lock.release()

    def sweep(self) -> None:
        """Delete what dead processes left: their drafts, and scratch of artifacts that were finished after all."""
        finished = {ref.id for ref in self.refs()}
        stale = [*_children(self.root / ".work" / "drafts")]
        stale += [path for path in _children(self.root / ".work" / "scratch") if path.name in finished]
        for path in stale:
            with self.lock(path.name, wait=False) as free:
                if free:
                    delete_tree(path)


def delete_tree(folder: Path) -> None:
    """Delete a folder and all below it, if it is there."""
    shutil.rmtree(folder, ignore_errors=not folder.exists())


def _children(folder: Path) -> list[Path]:
    return [Path(entry.path) for entry in os.scandir(folder)] if folder.is_dir() else []
