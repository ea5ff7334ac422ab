"""Critical states of demonstrations."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict
from pathlib import Path
from statistics import fmean
from typing import Any

from juicer.annotation.annotate import annotate as annotate_demonstrations
from juicer.annotation.labels import Label, read_labels
from juicer.annotation.measures import PEOPLE, measure
from juicer.annotation.propose import AnnotationConfig
from juicer.annotation.standing import agreed_labels
from juicer.annotation.versions import is_versions, read_versions
from juicer.artifacts.ref import ArtifactRef
from juicer.storage.annotations import write_annotations
from juicer.storage.episodes import EpisodeReader
from stages.runtime.context import StageContext
from stages.runtime.stage import stage


@stage(
    kind="annotations",
    inputs={"episodes": "episodes"},
    libraries=("mujoco", "numpy"),
    noun="critical states",
    counts="critical_states",
    headline=("episodes", "critical_states"),
)
def annotate(
    context: StageContext, *, episodes: ArtifactRef, labels: Path | None = None, config: AnnotationConfig
) -> None:
    """Find the critical states of demonstrations; what people say of them overrides."""
    demonstrations = EpisodeReader(context.store.open(episodes, "episodes"))
    demonstrations.require_state()
    given, measured = _read(labels, demonstrations) if labels else ([], {})
    rows = list(
        annotate_demonstrations(
            demonstrations,
            config,
            given,
            num_workers=context.machine.workers,
            progress=context.progress,
        )
    )
    write_annotations(context.draft.path, rows)
    context.draft.summary |= {
        "critical_states": len(rows),
        "episodes": len(demonstrations),
        "episodes_without": len(demonstrations) - len({row.episode_id for row in rows}),
        "mean_confidence": fmean(row.confidence for row in rows) if rows else 0.0,
        "authors": dict(Counter(row.author for row in rows)),
        **measured,
    }


def _read(path: Path, demonstrations: EpisodeReader) -> tuple[list[Label], dict[str, Any]]:
    """Labels of a file; of versions, those about these demonstrations that are agreed on, and their measures."""
    if not is_versions(path):
        return read_labels(path), {}
    versions = [version for version in read_versions(path) if version.episode in demonstrations.ids]
    measures = {name: value for name, value in asdict(measure(versions)).items() if value is not None}
    return agreed_labels(versions, path), {PEOPLE: measures}
