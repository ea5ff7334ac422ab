"""Looks at every file of the artifacts and says what it found, for people and for machines."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from juicer.artifacts.findings import Finding, Listing, Nature
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.errors import ArtifactError, ArtifactNotFound, DamagedArtifact, StrayFile, UnreadableArtifact

MANY_ARTIFACTS, MANY_CLAUSES = 8, 3
"""How many a sentence may name."""


@dataclass(frozen=True)
class Inspection:
    """What was found.

    Attributes:
        store: Where.
        findings: All that is wrong with each artifact that was looked at; nothing for those that are whole.
        unseen: Where there may be more artifacts that cannot be looked at.
    """

    store: ArtifactStore
    findings: Mapping[ArtifactRef, Sequence[Finding]]
    unseen: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """For machines: the clauses by artifact, for each nature of a finding."""
        natures = {
            nature.value: {str(ref): clauses for ref, clauses in self._with(nature).items()} for nature in Nature
        }
        return {"checked": len(self.findings), **natures, "unseen": list(self.unseen)}

    def notes(self) -> Iterator[str]:
        """What is good to know but no reason to fail, one line each."""
        for ref, clauses in self._with(Nature.LITTER).items():
            yield f"{ref}: {_some(clauses, MANY_CLAUSES)}; remove that from {self.store.address(ref)}, it does no harm"
        count = len(self.findings)
        if not count and not self.unseen:
            is_there = self.store.is_there()
            yield f"no artifacts in {self.store.url}" + ("" if is_there else ": there is no such place yet")
        elif self.error() is None:
            yield f"{count} artifact{'s are' if count != 1 else ' is'} as written"

    def error(self) -> ArtifactError | None:
        """What is a reason to fail, in one sentence; none if everything is as it was written."""
        parts: list[str] = []
        kinds: list[type[ArtifactError]] = []
        for nature, error_type, words in (
            (Nature.DAMAGE, DamagedArtifact, "are damaged: {}; mend each with `juicer repair ID`"),
            (Nature.STRAY, StrayFile, "hold what does not belong there: {}; remove that"),
            (Nature.UNREADABLE, UnreadableArtifact, "cannot be looked at: {}; see to their permissions"),
        ):
            if troubled := self._with(nature):
                named = [f"{ref}: {_some(clauses, MANY_CLAUSES)}" for ref, clauses in troubled.items()]
                parts.append(
                    f"{len(troubled)} of {len(self.findings)} artifacts "
                    + words.format(_some(named, MANY_ARTIFACTS, "; "))
                )
                kinds.append(error_type)
        if self.unseen:
            parts.append(f"there may be more artifacts: {_some(self.unseen, MANY_ARTIFACTS)}")
            kinds.append(UnreadableArtifact)
        return kinds[0]("; ".join(parts)) if parts else None

    def _with(self, nature: Nature) -> dict[ArtifactRef, list[str]]:
        chosen = {ref: [str(each) for each in found if each.nature is nature] for ref, found in self.findings.items()}
        return {ref: clauses for ref, clauses in chosen.items() if clauses}


def inspect(store: ArtifactStore, listing: Listing) -> Inspection:
    """Compare every file of the artifacts with their manifests."""
    findings: dict[ArtifactRef, Sequence[Finding]] = {}
    for ref in listing.refs:
        # It may have gone since the store was listed.
        with suppress(ArtifactNotFound):
            findings[ref] = store.verify(ref)
    return Inspection(store, findings, listing.unseen)


def _some(clauses: Sequence[str], most: int, separator: str = ", ") -> str:
    rest = len(clauses) - most
    return separator.join(clauses[:most]) + (f" and {rest} more" if rest > 0 else "")
