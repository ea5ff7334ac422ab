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
        cpu_seconds: CPU time of all processes that were busy with it; None if nobody has measured it.
    """

    ref: ArtifactRef
    path: Path
    scratch: Path
    adopted: bool = False
    summary: dict[str, Any] = field(default_factory=dict)
    cpu_seconds: float | None = None

    def take_facts(self, other: Draft) -> None:
        """Take over what another process, which filled the same folder, has to say of it."""
        self.summary |= other.summary
        self.cpu_seconds = other.cpu_seconds
