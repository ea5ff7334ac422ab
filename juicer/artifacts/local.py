"""Artifacts as folders of a local file system: ``<root>/<kind>/<id>/``."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from juicer.artifacts.integrity import DamageError, UnreadableError, find_problems, sync, sync_tree
from juicer.artifacts.manifest import MANIFEST_NAME, Manifest
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.workspace import Workspace, delete_tree, discard_tree


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

    def refs(self, kinds: Iterable[str]) -> list[ArtifactRef]:
        """Every artifact of the kinds, sorted."""
        folders = [folder for kind in kinds for folder in self.root.glob(f"{kind}/*/")]
        return sorted(ArtifactRef(folder.parent.name, folder.name) for folder in folders)

    def exists(self, ref: ArtifactRef) -> bool:
        """Whether the artifact was committed; says nothing about damage since."""
        return self.folder(ref).is_dir()

    def read_manifest(self, ref: ArtifactRef) -> Manifest:
        """Description of a committed artifact; see :class:`~juicer.artifacts.backend.Backend`."""
        try:
            content = (self.folder(ref) / MANIFEST_NAME).read_bytes()
        except (FileNotFoundError, NotADirectoryError):
            raise DamageError(f"file '{MANIFEST_NAME}' is missing") from None
        except IsADirectoryError:
            raise DamageError(f"file '{MANIFEST_NAME}' was replaced by something else") from None
        except OSError as error:
            raise UnreadableError(f"file '{MANIFEST_NAME}' cannot be read ({error.strerror})") from None
        return parse_manifest(content, ref)

    def problems(self, ref: ArtifactRef) -> list[str]:
        """Every way in which a committed artifact differs from its manifest, one clause each."""
        try:
            manifest = self.read_manifest(ref)
        except DamageError as damage:
            return [str(damage)]
        return find_problems(self.folder(ref), manifest.files)

    def open(self, ref: ArtifactRef) -> Path:
        """Folder of the artifact, compared with its manifest; see :class:`~juicer.artifacts.backend.Backend`."""
        if problems := self.problems(ref):
            raise DamageError(problems[0])
        return self.folder(ref)

    def recover(self, ref: ArtifactRef) -> bool:
        """Nothing to finish: a rename happens or does not."""
        return self.exists(ref)

    def check_writable(self) -> None:
        """Nothing to try: the draft's folder is made in the same place."""

    def commit(self, draft: Path, manifest: Manifest, *, replacing: bool = False) -> None:
        """Publish a draft: everything reaches the disk, and only then one rename makes it visible.

        If it replaces an artifact, that one goes only now, and comes back if the rename fails.
        """
        (draft / MANIFEST_NAME).write_text(manifest.to_text(), encoding="utf-8")
        sync_tree(draft)
        target = self.folder(manifest.ref)
        target.parent.mkdir(parents=True, exist_ok=True)
        old = self._bury(manifest.ref) if target.exists() else None
        try:
            draft.rename(target)
        except BaseException:
            if old:
                old.rename(target)
            raise
        sync(target.parent)
        sync(self.root)
        if old:
            discard_tree(old)

    def remove(self, ref: ArtifactRef) -> None:
        """Take an artifact away: one rename makes it invisible, then delete it."""
        delete_tree(self._bury(ref))

    def _bury(self, ref: ArtifactRef) -> Path:
        """Move an artifact to where a sweep would find it, if its deletion is cut short."""
        grave = self.work.grave(ref.id)
        delete_tree(grave)
        grave.parent.mkdir(parents=True, exist_ok=True)
        self.folder(ref).rename(grave)
        return grave


def parse_manifest(content: bytes, ref: ArtifactRef) -> Manifest:
    """Read the manifest that should be that of ``ref``.

    Raises:
        DamageError: If it is altered, or that of another artifact.
    """
    try:
        manifest = Manifest.from_text(content.decode("utf-8"))
    except ValueError as error:
        raise DamageError(f"file '{MANIFEST_NAME}' is unusable: {error}") from None
    if manifest.ref != ref:
        raise DamageError(f"file '{MANIFEST_NAME}' is that of {manifest.ref}")
    return manifest
