"""Where a store keeps its artifacts: what local folders and remote stores have in common."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Protocol

from juicer.artifacts.findings import Finding, Listing, damaged, unreadable
from juicer.artifacts.manifest import MANIFEST_NAME, AnotherVersionError, Manifest
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.workspace import Workspace
from juicer.text import printable

ASIDE = ".aside"
"""Folder of a store for what is no artifact any more, but was not juicer's to delete:
``.aside/<kind>/<id>/<number>/``."""


def next_room(names: Iterable[str]) -> int:
    """Number of the next folder beside those of these names: greater than any, though some may have been removed."""
    return 1 + max((int(name) for name in names if name.isdecimal()), default=0)


class Backend(Protocol):
    """Keeper of committed artifacts; whatever makes, moves or mends one does so under its lock in ``work``.

    What differs from what was written is never deleted, only set aside: it may be all that is left of something.
    """

    @property
    def work(self) -> Workspace:
        """Local folders for work in progress."""
        ...

    def is_there(self) -> bool:
        """Whether there is a store at all; one that has no artifact yet need not be."""
        ...

    def survey(self, kinds: Iterable[str], beginning: str = "") -> Listing:
        """Every artifact of the kinds whose id begins so, and where there may be more that cannot be looked at."""
        ...

    def exists(self, ref: ArtifactRef) -> bool:
        """Whether the artifact was committed; says nothing about damage since.

        Raises:
            TroubleError: If that cannot be found out.
        """
        ...

    def address(self, ref: ArtifactRef) -> str:
        """Where the artifact is, or would be, for people."""
        ...

    def read(self, ref: ArtifactRef) -> bytes:
        """Manifest of a committed artifact as it was written.

        Raises:
            TroubleError: If it is missing, cannot be read, or is no manifest for its sheer size.
        """
        ...

    def stamp(self, ref: ArtifactRef) -> str:
        """What changes whenever the manifest is written; empty if that cannot be told without reading it."""
        ...

    def problems(self, ref: ArtifactRef) -> list[Finding]:
        """Everything that is wrong with a committed artifact, to the last byte."""
        ...

    def open(self, ref: ArtifactRef, read: Collection[str] | None = None) -> Path:
        """Local folder with all files of a committed artifact, compared with its manifest just now.

        Args:
            ref: The artifact.
            read: Paths of the files that are going to be read, whose contents count; all if None. See
                :func:`~juicer.artifacts.integrity.find_obstacles`.

        Raises:
            TroubleError: If they differ.
        """
        ...

    def recover(self, ref: ArtifactRef) -> bool:
        """Finish or take back a commit that was cut short, if all is at hand; gives whether it exists now."""
        ...

    def mend(self, ref: ArtifactRef) -> bool:
        """Make a damaged artifact whole from what is at hand, without making it again; gives whether that worked."""
        ...

    def sweep(self) -> None:
        """Clear away what dead processes left."""
        ...

    def check_writable(self, ref: ArtifactRef) -> None:
        """Find out before the work, not after it, whether its result could be kept.

        Raises:
            StoreNotWritable: If not; or the OSError that tells why.
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

    def set_aside(self, ref: ArtifactRef) -> str:
        """Take an artifact out of the store, unchanged; gives where it is now."""
        ...

    def asides(self, ref: ArtifactRef) -> list[str]:
        """What was set aside of an artifact, oldest first."""
        ...


def read_manifest(backend: Backend, ref: ArtifactRef) -> Manifest:
    """Description of a committed artifact.

    Raises:
        TroubleError: If the manifest is missing, altered, that of another artifact, or cannot be read.
    """
    return parse_manifest(backend.read(ref), ref)


def parse_manifest(content: bytes, ref: ArtifactRef) -> Manifest:
    """Read the manifest that should be that of ``ref``.

    Raises:
        TroubleError: If it is altered, that of another artifact, or of a later juicer.
    """
    try:
        manifest = Manifest.from_text(content.decode("utf-8"))
    except AnotherVersionError as error:
        raise unreadable(f"file '{MANIFEST_NAME}' is unusable: {error}", "use the juicer that wrote it") from None
    except ValueError as error:
        raise damaged(f"file '{MANIFEST_NAME}' is unusable: {printable(error)}") from None
    if manifest.ref != ref:
        raise damaged(f"file '{MANIFEST_NAME}' is that of {manifest.ref}")
    return manifest


def salvage_manifest(content: bytes, ref: ArtifactRef) -> Manifest | None:
    """What the altered manifest of ``ref`` said, if that can be told for certain."""
    manifest = Manifest.salvage(content.decode("utf-8", errors="replace"))
    return manifest if manifest is not None and manifest.ref == ref else None
