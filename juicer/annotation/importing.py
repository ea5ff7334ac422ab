"""Labels of a file among what people said, as if they had been marked on the page."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from juicer.annotation.annotate import labelled
from juicer.annotation.labels import Label
from juicer.annotation.standing import standing
from juicer.annotation.versions import Entry, Version, read_versions, save
from juicer.episode import DemonstrationReader
from juicer.errors import InvalidLabels
from juicer.problems import first_problem
from juicer.tasks.registry import get_task


def import_labels(
    path: Path, labels: Iterable[Label], demonstrations: DemonstrationReader, author: str, tool: str, time: str
) -> list[Version]:
    """Save labels as versions; what the same author has said already in the same words is left out.

    Args:
        path: File of versions.
        labels: What the author said.
        demonstrations: What it is about, of one task.
        author: Who said it.
        tool: With what.
        time: When it was imported, in ISO 8601.

    Raises:
        InvalidLabels: If a label names what is not there, or the file of versions cannot be understood.
        AnnotationConflict: If somebody annotated the same at the same time.
        AnnotationsNotSaved: If the disk refuses.
    """
    stands = standing(read_versions(path))
    num_critical_states = get_task(demonstrations.records[0].task).num_critical_states
    entries = []
    for index, rows in labelled(demonstrations, labels, num_critical_states).items():
        episode = demonstrations.read(index)
        for row in rows:
            known = stands.get((row.episode_id, row.critical_state))
            step = episode.recorded_step(row.step)
            if known and any((each.author, each.step) == (author, step) for each in known.opinions):
                continue
            said = {"episode": row.episode_id, "critical_state": row.critical_state, "step": step}
            after = known.newest if known else 0
            entries.append(_entry({**said, "after": after, "author": author, "tool": tool, "time": time}))
    return save(path, entries) if entries else []


def _entry(content: Mapping[str, Any]) -> Entry:
    try:
        return Entry.model_validate(content)
    except ValidationError as error:
        raise InvalidLabels(first_problem(error, content, Entry).sentence) from None
