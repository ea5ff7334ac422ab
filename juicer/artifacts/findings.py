"""What can be wrong with an artifact, and what is to be done about it."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum

from juicer.artifacts.ref import ArtifactRef


class Nature(Enum):
    """What a finding means: only damage is a reason to make an artifact again."""

    DAMAGE = "damaged"
    """A file is missing or not as it was written."""
    STRAY = "stray"
    """Something lies there that does not belong; a reader of the files might take it for one of them."""
    LITTER = "litter"
    """As above, but dropped by an operating system or an editor, under a name that no reader asks for."""
    UNREADABLE = "unreadable"
    """It cannot be looked at, and may be whole."""


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong with an artifact.

    Attributes:
        nature: What it means.
        clause: What was found, in words; names the file.
        remedy: What is to be done, if its nature does not say that.
    """

    nature: Nature
    clause: str
    remedy: str = ""

    def __str__(self) -> str:
        """The clause."""
        return self.clause


@dataclass(frozen=True)
class Listing:
    """What a store holds.

    Attributes:
        refs: Every artifact, sorted.
        unseen: Where there may be more of them that cannot be looked at, one clause a place.
    """

    refs: tuple[ArtifactRef, ...]
    unseen: tuple[str, ...] = ()


class TroubleError(Exception):
    """Something is wrong with an artifact; for use within this package."""

    def __init__(self, finding: Finding) -> None:
        super().__init__(finding.clause)
        self.finding = finding


def damaged(clause: str) -> TroubleError:
    """Error that tells of damage."""
    return TroubleError(Finding(Nature.DAMAGE, clause))


def unreadable(clause: str, remedy: str = "") -> TroubleError:
    """Error that tells of something which cannot be looked at."""
    return TroubleError(Finding(Nature.UNREADABLE, clause, remedy))


def raise_worst(findings: Iterable[Finding]) -> None:
    """Do nothing if an artifact may be used in spite of the findings.

    Raises:
        TroubleError: With the finding to be dealt with first, if it may not.
    """
    for nature in (Nature.UNREADABLE, Nature.DAMAGE, Nature.STRAY):
        for finding in findings:
            if finding.nature is nature:
                raise TroubleError(finding)


def is_as_written(findings: Iterable[Finding]) -> bool:
    """Whether nothing but an operating system's litter was found."""
    return all(finding.nature is Nature.LITTER for finding in findings)


_LITTER = (
    # macOS
    ".ds_store",
    "._*",
    ".appledouble",
    ".localized",
    "icon\r",
    ".spotlight-v100",
    ".fseventsd",
    ".trashes",
    "__macosx",
    # Windows
    "thumbs.db",
    "ehthumbs.db",
    "desktop.ini",
    # network file systems, desktops, synchronisation
    ".nfs*",
    ".fuse_hidden*",
    ".smbdelete*",
    ".directory",
    ".trash-*",
    "@eadir",
    ".goutputstream-*",
    ".~lock.*#",
    ".syncthing.*.tmp",
    "~syncthing~*",
    # editors
    "*~",
    "*.bak",
    ".*.sw[a-p]",
    "#*#",
    ".#*",
    ".*.kate-swp",
    ".ipynb_checkpoints",
)
"""Names in small letters that operating systems and editors give to what they leave behind."""


def is_litter(name: str) -> bool:
    """Whether a file or folder of this name was left behind by an operating system or an editor."""
    return any(fnmatch.fnmatchcase(name.lower(), pattern) for pattern in _LITTER)
