"""What a store holds, as DataFrames."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd

from juicer.artifacts.catalog import Entry, catalog_of
from juicer.artifacts.manifest import FINDING, HEADLINE, LABEL, OBSERVES
from juicer.artifacts.ref import ArtifactRef, require_kind
from juicer.artifacts.store import ArtifactStore
from juicer.episode import Episode, Outcome, Role
from juicer.library.names import read_models
from juicer.reporting.lineage import read_lineage
from juicer.sim.registration import environment_id
from juicer.storage.annotations import Annotation, read_annotations
from juicer.storage.curves import Curves
from juicer.storage.dataset import DatasetRow, read_dataset
from juicer.storage.frames import frame_of
from juicer.storage.selections import SelectionRow, read_selection
from juicer.tasks.registry import TASK_NAMES, get_task
from juicer.text import printable

logger = logging.getLogger(__name__)


def artifact_table(store: ArtifactStore, kind: str | None) -> pd.DataFrame:
    """A row an artifact, oldest first; with a kind, a column for each number and word of the summaries, too.

    Raises:
        ConfigError: If there is no such kind.
    """
    if kind is not None:
        require_kind(kind)
    names = {ref: model.name for model in read_models(store) for ref in (model.evaluation, model.checkpoint)}
    rows = [
        {**_described(entry), "name": names.get(entry.ref, ""), **(_facts(entry) if kind else {})}
        for entry in _entries(store, kind)
    ]
    columns = ["id", "kind", "name", "stage", "finished", "seconds", "megabytes", HEADLINE]
    table = pd.DataFrame(rows, columns=columns if not rows else None)
    return table[[*columns, *(name for name in table.columns if name not in columns)]].set_index("id")


def model_table(store: ArtifactStore) -> pd.DataFrame:
    """A row a model that a report names, with what it saw and what its evaluation found."""
    found = ("episodes", "successes", "success_rate", "interval_low", "interval_high", "mean_length")
    models = read_models(store)
    known = catalog_of(store, store.cache).of([model.evaluation for model in models])
    rows = []
    for model in models:
        summary = known[model.evaluation].summary if model.evaluation in known else {}
        _, _, condition, _ = model.words
        rows.append(
            {
                "name": model.name,
                "study": model.study,
                "task": model.task,
                "condition": condition,
                "seed": model.seed,
                OBSERVES: str(summary.get(OBSERVES, "")),
                **{name: summary.get(name) for name in found},
                "evaluation": model.evaluation.id,
                "checkpoint": model.checkpoint.id if model.checkpoint else None,
                "report": model.report.id,
            }
        )
    columns = ["name", "study", "task", "condition", "seed", OBSERVES, *found, "evaluation", "checkpoint", "report"]
    return pd.DataFrame(rows, columns=columns).set_index("name")


def lineage_table(store: ArtifactStore, ref: ArtifactRef) -> pd.DataFrame:
    """An artifact and everything it was made from, parents first; what was deleted has only its id."""
    rows = []
    for each, manifest in read_lineage(store, [ref]).items():
        parents = [parent.id for parent in manifest.recipe.parents] if manifest else []
        described = _described(Entry.of(manifest)) if manifest else {"id": each.id, "kind": each.kind}
        rows.append(described | {"parents": parents})
    return pd.DataFrame(rows).set_index("id")


def episode_table(rows: Sequence[Any], row_type: type[Any]) -> pd.DataFrame:
    """A row an episode, of a type with ``outcome`` and ``milestones``; each milestone's step has a column.

    Milestones stand in the order in which they are first reached.
    """
    steps: dict[str, int] = {}
    for row in rows:
        for name, step in row.milestones.items():
            steps[name] = min(step, steps.get(name, step))
    table = frame_of(rows, row_type).drop(columns="milestones")
    table.insert(table.columns.get_loc("outcome") + 1, "success", table["outcome"] == Outcome.SUCCESS.value)
    for name in sorted(steps, key=lambda name: steps[name]):
        table[name] = pd.array([row.milestones.get(name) for row in rows], dtype="Int64")
    return table


def step_table(episode: Episode) -> pd.DataFrame:
    """A row a step; columns are the name of an array and the place in it, so that ``table["action"]`` is one of both.

    Simulator states and arrays of more than one dimension a step, such as images, are left out.
    """
    shown = [name for name in episode.schema.names() if episode.steps[name].ndim <= 2]
    hidden = episode.schema.names(Role.STATE)
    arrays = {name: episode.steps[name].reshape(len(episode), -1) for name in shown if name not in hidden}
    frames = {name: pd.DataFrame(values) for name, values in arrays.items()}
    return pd.concat(frames, axis=1).rename_axis(index="step", columns=["array", "place"])


def curve_table(curves: Curves) -> pd.DataFrame:
    """A row an optimiser step, a column a curve; NaN where a curve was not measured."""
    columns = {name: pd.Series(values, index=list(steps), dtype=float) for name, (steps, values) in curves.items()}
    return pd.DataFrame(columns).rename_axis(index="step")


def task_table() -> pd.DataFrame:
    """A row an assembly task."""
    tasks = [get_task(name) for name in TASK_NAMES]
    rows = [
        {
            "task": task.name,
            "environment": environment_id(task.name),
            "parts": len(task.parts),
            "pairs": len(task.pairs),
            "max_steps": task.max_steps,
            "critical_states": ", ".join(task.critical_state_names),
            "milestones": ", ".join(task.milestones),
        }
        for task in tasks
    ]
    return pd.DataFrame(rows).set_index("task")


def row_table(store: ArtifactStore, ref: ArtifactRef) -> pd.DataFrame:
    """Rows of annotations, a selection or a dataset.

    Raises:
        ArtifactError: If the artifact is damaged.
    """
    folder = store.open(ref)
    if ref.kind == "annotations":
        return frame_of(read_annotations(folder), Annotation)
    if ref.kind == "selection":
        return frame_of(read_selection(folder), SelectionRow)
    return frame_of(read_dataset(folder), DatasetRow)


def _entries(store: ArtifactStore, kind: str | None) -> list[Entry]:
    """Artifacts, oldest first; what cannot be had is logged and left out."""
    contents = catalog_of(store, store.cache).whole(kind)
    for trouble in (*contents.unseen, *(entry.trouble for entry in contents.entries if entry.trouble)):
        logger.warning("the table is not complete: %s", trouble)
    return [entry for entry in reversed(contents.entries) if not entry.trouble]


def _described(entry: Entry) -> dict[str, Any]:
    return {
        "id": entry.ref.id,
        "kind": entry.ref.kind,
        "stage": printable(entry.stage),
        "finished": pd.Timestamp(entry.finished).tz_convert("UTC").floor("s"),
        "seconds": entry.seconds,
        "megabytes": round(entry.bytes / 1e6, 3),
        HEADLINE: printable(entry.headline),
    }


def _facts(entry: Entry) -> Mapping[str, Any]:
    """Numbers and words of a summary; what has an inside of its own stays in the manifest."""
    return {
        name: value
        for name, value in entry.summary.items()
        if name not in (HEADLINE, LABEL, FINDING) and isinstance(value, int | float | str)
    }
