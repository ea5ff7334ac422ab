"""Sets of demonstrations that can be annotated."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache

from juicer.annotation.measures import measure
from juicer.annotation.versions import Version, read_versions, versions_path
from juicer.artifacts.catalog import Entry
from juicer.errors import JuicerError
from juicer.pages.workplace import Workplace
from juicer.storage.episodes import EpisodeReader

_STAGE = "ingest"


@dataclass(frozen=True)
class Annotatable:
    """A set of demonstrations.

    Attributes:
        entry: Its artifact.
        task: Its task.
        annotated: Of how many demonstrations people have marked something.
        disputed: About how many critical states annotators disagree.
        problem: Why it cannot be annotated; empty if it can.
    """

    entry: Entry
    task: str
    annotated: int = 0
    disputed: int = 0
    problem: str = ""


def demonstrations(entries: Iterable[Entry]) -> Sequence[Entry]:
    """Those that were ingested."""
    return [entry for entry in entries if entry.stage == _STAGE and entry.ref.kind == "episodes"]


def look_at(workplace: Workplace, entries: Iterable[Entry]) -> list[Annotatable]:
    """How far the annotation of sets of demonstrations is."""
    # Sets of one task share a file, which may be long.
    versions_of = cache(lambda task: read_versions(versions_path(workplace.folder, task)))
    return [_look(workplace, entry, versions_of) for entry in entries]


def _look(workplace: Workplace, entry: Entry, versions_of: Callable[[str], Sequence[Version]]) -> Annotatable:
    task = ", ".join(entry.tasks)
    try:
        reader = EpisodeReader(workplace.store.open(entry.ref, "episodes"))
        reader.require_state()
        task = reader.records[0].task if reader.records else task
        measures = measure([version for version in versions_of(task) if version.episode in reader.ids])
    except JuicerError as error:
        return Annotatable(entry, task, problem=str(error))
    return Annotatable(entry, task, measures.demonstrations, measures.disputed)
