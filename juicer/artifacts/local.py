"""Artifacts as folders of a local file system: ``<root>/<kind>/<id>/``."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Collection, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import count
from pathlib import Path

from juicer.artifacts.backend import ASIDE, next_room, parse_manifest, salvage_manifest
from juicer.artifacts.contents import written
from juicer.artifacts.findings import (
    Finding,
    Listing,
    TroubleError,
    damaged,
    is_as_written,
    raise_worst,
    unreadable,
)
from juicer.artifacts.integrity import find_obstacles, find_problems, sync, sync_tree
from juicer.artifacts.manifest import MANIFEST_NAME, MOST_BYTES, FileEntry, Manifest
from juicer.artifacts.ref import KINDS, ArtifactRef, is_id
from juicer.artifacts.workspace import Workspace, discard_tree
from juicer.errors import ArtifactError
from juicer.reading import UnsuitableFile, read_bounded

logger = logging.getLogger(__name__)

Find = Callable[[Path, Sequence[FileEntry]], list[Finding]]
"""Compares a folder with the files it should hold."""


@dataclass(frozen=True)
class LocalBackend:
    """Folders below one root. An artifact exists if and only if its folder does: one rename makes it appear."""

    root: Path

    @property
    def work(self) -> Workspace:
        """Hidden folders beside the artifacts, on the same file system, so that a rename can publish them."""
        return Workspace(self.root / ".work")

    def folder(self, ref: ArtifactRef) -> Path:
        """Where the artifact is, or would be."""
        return self.root / ref.kind / ref.id

    def address(self, ref: ArtifactRef) -> str:
        """Its folder."""
        return str(self.folder(ref))

    def is_there(self) -> bool:
        """Whether there is something at the root."""
        return os.path.lexists(self.root)

    def survey(self, kinds: Iterable[str], beginning: str = "") -> Listing:
        """Every artifact of the kinds whose id begins so, and where there may be more that cannot be looked at.

        Whatever is named like an artifact takes its place, and counts as one that may be damaged; nothing else does.
        """
        refs: list[ArtifactRef] = []
        unseen: list[str] = []
        for kind in kinds:
            try:
                with os.scandir(self.root / kind) as entries:
                    names = [entry.name for entry in entries]
            except OSError as error:
                if self._may_hide(self.root / kind, error):
                    unseen.append(f"folder '{_blocking(self.root / kind)}' cannot be read ({error.strerror})")
            else:
                refs += [ArtifactRef(kind, name) for name in names if name.startswith(beginning) and is_id(name)]
        return Listing(tuple(sorted(refs)), tuple(dict.fromkeys(unseen)))

    def exists(self, ref: ArtifactRef) -> bool:
        """Whether there is something in the artifact's place."""
        try:
            os.lstat(self.folder(ref))
        except (FileNotFoundError, NotADirectoryError):
            return False
        except OSError as error:
            place = _blocking(self.folder(ref).parent)
            raise unreadable(f"folder '{place}' cannot be read ({error.strerror})") from None
        return True

    def read(self, ref: ArtifactRef) -> bytes:
        """Manifest of a committed artifact as it was written; see :class:`~juicer.artifacts.backend.Backend`."""
        return _read(self.folder(ref))

    def stamp(self, ref: ArtifactRef) -> str:
        """All that the file system says about the manifest; see :class:`~juicer.artifacts.backend.Backend`."""
        try:
            # Of ten thousand at a time, of which a Path would take twice as long.
            return "-".join(map(str, written(os.stat(f"{self.root}/{ref}/{MANIFEST_NAME}"))))  # noqa: PTH116
        except OSError:
            return ""

    def problems(self, ref: ArtifactRef) -> list[Finding]:
        """Everything that is wrong with a committed artifact, to the last byte."""
        return self._look(ref, find_problems)

    def obstacles(self, ref: ArtifactRef, read: Collection[str] | None = None) -> list[Finding]:
        """What keeps a committed artifact from being read; see :meth:`open`."""
        return self._look(ref, lambda folder, expected: find_obstacles(folder, expected, read))

    def open(self, ref: ArtifactRef, read: Collection[str] | None = None) -> Path:
        """Folder of the artifact, compared with its manifest; see :class:`~juicer.artifacts.backend.Backend`."""
        raise_worst(self.obstacles(ref, read))
        return self.folder(ref)

    def recover(self, ref: ArtifactRef) -> bool:
        """Put an artifact back whose successor was never published."""
        grave = self.work.grave(ref)
        if self.exists(ref) or not os.path.isdir(grave):  # noqa: PTH112 (says no where it may not look)
            return self.exists(ref)
        # What is not whole was about to be deleted, after its successor had been published.
        if not is_as_written(_found_in(grave, ref, find_problems)):
            return False
        self.folder(ref).parent.mkdir(parents=True, exist_ok=True)
        grave.rename(self.folder(ref))
        return True

    def mend(self, ref: ArtifactRef) -> bool:
        """Write the manifest anew whose content is whole by its own checksum, though not its text."""
        try:
            content = self.read(ref)
        except TroubleError:
            return False
        manifest = salvage_manifest(content, ref)
        if manifest is None or manifest.to_text().encode() == content:
            return False
        (self._room_aside(ref) / MANIFEST_NAME).write_bytes(content)
        path = self.folder(ref) / MANIFEST_NAME
        # Its name is that of litter, should a kill leave it there.
        draft = path.with_name(f".#{path.name}")
        draft.write_text(manifest.to_text(), encoding="utf-8")
        sync(draft)
        draft.replace(path)
        sync(path.parent)
        return True

    def sweep(self) -> None:
        """Clear away what dead processes left; an artifact whose successor was never published comes back."""
        try:
            self.work.sweep(self._made_at)
            for ref in self.work.graves():
                with self.work.lock_if_free(ref.id) as is_held:
                    if is_held:
                        self.recover(ref)
                        discard_tree(self.work.grave(ref))
        except OSError as error:
            logger.warning("what earlier runs left in '%s' cannot be cleared away: %s", self.work.root, error.strerror)

    def check_writable(self, ref: ArtifactRef) -> None:
        """Move an empty folder to where the artifact will appear, and back."""
        draft, probe = self.work.draft(ref.id), self.folder(ref).with_name(f".{ref.id}")
        probe.parent.mkdir(parents=True, exist_ok=True)
        draft.mkdir(parents=True, exist_ok=True)
        draft.rename(probe)
        probe.rename(draft)
        draft.rmdir()

    def commit(self, draft: Path, manifest: Manifest, *, replacing: bool = False) -> None:
        """Publish a draft: everything reaches the disk, and only then one rename makes it visible.

        If it replaces an artifact, that one goes only now, and comes back if the rename fails.
        """
        text = manifest.to_text()
        if len(text) > MOST_BYTES:
            raise ArtifactError(
                f"{manifest.ref} has {len(manifest.files):,} files, more than a manifest can name; make smaller ones"
            )
        (draft / MANIFEST_NAME).write_text(text, encoding="utf-8")
        sync_tree(draft)
        ref = manifest.ref
        target = self.folder(ref)
        target.parent.mkdir(parents=True, exist_ok=True)
        old = self._clear(ref) if self.exists(ref) else None
        try:
            draft.rename(target)
        except BaseException:
            if old:
                old.rename(target)
            raise
        sync(target.parent)
        sync(self.root)
        if old == self.work.grave(ref):
            discard_tree(old)
        elif old:
            logger.warning("what lay in the place of %s was not as it was written; it is kept in '%s'", ref, old)

    def set_aside(self, ref: ArtifactRef) -> str:
        """Move an artifact out of the store, unchanged."""
        return str(self._move_aside(ref))

    def asides(self, ref: ArtifactRef) -> list[str]:
        """What was set aside of an artifact, oldest first."""
        holder = self.root / ASIDE / ref.kind / ref.id
        with suppress(OSError):
            return [str(path) for path in sorted(holder.iterdir(), key=lambda path: (len(path.name), path.name))]
        return []

    def _look(self, ref: ArtifactRef, find: Find) -> list[Finding]:
        findings = _found_in(self.folder(ref), ref, find)
        if is_as_written(findings):
            return findings
        # It may have been replaced while it was looked at.
        again = _found_in(self.folder(ref), ref, find)
        return again if is_as_written(again) else findings

    def _clear(self, ref: ArtifactRef) -> Path:
        """Make room for a successor; gives where the artifact waits, to be deleted or kept."""
        if not is_as_written(self.problems(ref)):
            return self._move_aside(ref)
        grave = self.work.grave(ref)
        discard_tree(grave)
        grave.parent.mkdir(parents=True, exist_ok=True)
        self.folder(ref).rename(grave)
        return grave

    def _move_aside(self, ref: ArtifactRef) -> Path:
        folder, room = self.folder(ref), self._room_aside(ref)
        # A folder takes the place of an empty one; what else may stand there does not.
        aside = room / ref.id if folder.is_symlink() or not folder.is_dir() else room
        try:
            return folder.rename(aside)
        except OSError:
            room.rmdir()
            raise

    def _room_aside(self, ref: ArtifactRef) -> Path:
        """A new and empty folder for what must not be deleted."""
        holder = self.root / ASIDE / ref.kind / ref.id
        holder.mkdir(parents=True, exist_ok=True)
        for number in count(next_room(path.name for path in holder.iterdir())):
            with suppress(FileExistsError):
                (holder / str(number)).mkdir()
                break
        return holder / str(number)

    def _may_hide(self, folder: Path, error: OSError) -> bool:
        """Whether there may be something in a folder although it cannot be listed: not if there is no such folder."""
        is_absent = isinstance(error, FileNotFoundError) and not os.path.lexists(folder)
        return not is_absent or (os.path.lexists(self.root) and not self.root.is_dir())

    def _made_at(self, identity: str) -> float | None:
        for kind in KINDS:
            with suppress(OSError):
                return (self.root / kind / identity / MANIFEST_NAME).stat().st_mtime
        return None


def _read(folder: Path) -> bytes:
    try:
        return read_bounded(folder / MANIFEST_NAME, MOST_BYTES)
    except (FileNotFoundError, NotADirectoryError):
        if not folder.is_dir():
            raise damaged("something else stands in the place of its folder") from None
        raise damaged(f"file '{MANIFEST_NAME}' is missing") from None
    except UnsuitableFile as error:
        raise damaged(f"file '{MANIFEST_NAME}' is unusable: {error.strerror}") from None
    except OSError as error:
        raise unreadable(f"file '{MANIFEST_NAME}' cannot be read ({error.strerror})") from None


def _found_in(folder: Path, ref: ArtifactRef, find: Find) -> list[Finding]:
    try:
        return find(folder, parse_manifest(_read(folder), ref).files)
    except TroubleError as trouble:
        return [trouble.finding]


def _blocking(folder: Path) -> Path:
    """The topmost folder on the way to a folder that cannot be entered, or is none; else that folder itself."""
    for each in reversed(folder.parents):
        if not each.is_dir() or not os.access(each, os.X_OK):
            return each
    return folder
