"""Critical states of demonstrations."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from statistics import fmean

from juicer.annotation.annotate import annotate as annotate_demonstrations
from juicer.annotation.labels import read_labels
from juicer.annotation.propose import AnnotationConfig
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
    """Find the critical states of demonstrations; a human's labels file overrides."""
    demonstrations = EpisodeReader(context.store.open(episodes, "episodes"))
    demonstrations.require_state()
    rows = list(
        annotate_demonstrations(
            demonstrations,
            config,
            read_labels(labels) if labels else (),
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
    }
