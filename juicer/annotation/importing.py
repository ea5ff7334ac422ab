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
from juicer.tasks.specification import AssemblyTask


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
    task = get_task(demonstrations.records[0].task)
    labels = list(labels)
    _check_asked_for(labels, task)
    entries = []
    for index, rows in labelled(demonstrations, labels, task.num_critical_states).items():
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


def _check_asked_for(labels: Iterable[Label], task: AssemblyTask) -> None:
    further = range(task.num_critical_states, task.num_critical_states + len(task.further_states))
    if label := next((each for each in labels if each.critical_state in further), None):
        names = ", ".join(map(task.name_of, task.further_states))
        raise InvalidLabels(
            f"{label.where}: critical state {label.critical_state} is one of those that annotate.critical_states adds "
            f"({names}); the page does not ask for them, so remove their rows, or give the file to a run as its labels"
        )


def _entry(content: Mapping[str, Any]) -> Entry:
    try:
        return Entry.model_validate(content)
    except ValidationError as error:
        raise InvalidLabels(first_problem(error, content, Entry).sentence) from None
