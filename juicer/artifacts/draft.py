"""An artifact in the making."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from juicer.artifacts.ref import ArtifactRef


@dataclass
class Draft:
    """What a stage body fills.

    Attributes:
        ref: The artifact it becomes.
        path: Hidden folder for the artifact's files.
        scratch: Folder that outlives a killed run and is removed at commit, for resuming long work.
        adopted: Another process finished the artifact meanwhile; nothing is to be done, and there is no folder to fill.
        summary: JSON facts for people: counts, rates. NaN and infinities are stored as null.
    """

    ref: ArtifactRef
    path: Path
    scratch: Path
    adopted: bool = False
    summary: dict[str, Any] = field(default_factory=dict)
