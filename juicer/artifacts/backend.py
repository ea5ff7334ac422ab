"""Where a store keeps its artifacts: what local folders and remote stores have in common."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Protocol

from juicer.artifacts.manifest import Manifest
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.workspace import Workspace


class Backend(Protocol):
    """Keeper of committed artifacts; whatever makes or removes one does so under its lock in ``work``."""

    @property
    def work(self) -> Workspace:
        """Local folders for work in progress."""
        ...

    def refs(self, kinds: Iterable[str]) -> list[ArtifactRef]:
        """Every artifact of the kinds, sorted."""
        ...

    def exists(self, ref: ArtifactRef) -> bool:
        """Whether the artifact was committed; says nothing about damage since."""
        ...

    def read_manifest(self, ref: ArtifactRef) -> Manifest:
        """Description of a committed artifact.

        Raises:
            DamageError: If the manifest is missing, altered, or that of another artifact.
            UnreadableError: If the disk does not let it be read.
        """
        ...

    def problems(self, ref: ArtifactRef) -> list[str]:
        """Every way in which a committed artifact differs from its manifest, one clause each."""
        ...

    def open(self, ref: ArtifactRef) -> Path:
        """Local folder with all files of a committed artifact, compared with its manifest just now.

        Raises:
            DamageError: If they differ.
        """
        ...

    def recover(self, ref: ArtifactRef) -> bool:
        """Finish a commit that was cut short, if all of the artifact is at hand; gives whether it exists now."""
        ...

    def check_writable(self) -> None:
        """Find out before the work, not after it, whether its result could be kept.

        Raises:
            StoreNotWritable: If not.
        """
        ...

    def commit(self, draft: Path, manifest: Manifest, *, replacing: bool = False) -> None:
        """Publish the files of a draft: afterwards the artifact exists whole, at a failure or kill it does not.

        Args:
            draft: Folder with the files.
            manifest: Their description.
            replacing: Whether it takes the place of an artifact, whole or damaged; at a failure that one stays.
        """
        ...

    def remove(self, ref: ArtifactRef) -> None:
        """Take an artifact away, whole or damaged; it is invisible before its first file goes."""
        ...
