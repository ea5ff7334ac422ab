"""Sets of demonstrations that can be annotated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from juicer.annotation.measures import measure
from juicer.annotation.versions import read_versions, versions_path
from juicer.artifacts.manifest import Manifest
from juicer.errors import JuicerError
from juicer.pages.workplace import Workplace
from juicer.storage.episodes import EpisodeReader

_STAGE = "ingest"


@dataclass(frozen=True)
class Annotatable:
    """A set of demonstrations.

    Attributes:
        manifest: Of its artifact.
        task: Its task.
        annotated: Of how many demonstrations people have marked something.
        disputed: About how many critical states annotators disagree.
        problem: Why it cannot be annotated; empty if it can.
    """

    manifest: Manifest
    task: str
    annotated: int = 0
    disputed: int = 0
    problem: str = ""


def annotatable(workplace: Workplace) -> Sequence[Annotatable]:
    """Demonstrations that were ingested, the newest first."""
    manifests = [each for each in workplace.store.list("episodes") if each.recipe.stage == _STAGE]
    return [_look(workplace, each) for each in sorted(manifests, key=lambda each: each.finished, reverse=True)]


def _look(workplace: Workplace, manifest: Manifest) -> Annotatable:
    task = str(manifest.recipe.config.get("task", ""))
    try:
        reader = EpisodeReader(workplace.store.open(manifest.ref, "episodes"))
        reader.require_state()
        versions = read_versions(versions_path(workplace.folder, task))
        measures = measure([version for version in versions if version.episode in reader.ids])
    except JuicerError as error:
        return Annotatable(manifest, task, problem=str(error))
    return Annotatable(manifest, task, measures.demonstrations, measures.disputed)
