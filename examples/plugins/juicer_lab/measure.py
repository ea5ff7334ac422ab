"""A stage from outside: how long episodes are."""

from __future__ import annotations

import json

from juicer.artifacts.ref import ArtifactRef
from juicer.config import StrictConfig
from juicer.storage.episodes import EpisodeReader
from stages.runtime.context import StageContext
from stages.runtime.stage import stage


class MeasureConfig(StrictConfig):
    """Nothing to choose."""


@stage(kind="lengths", inputs={"episodes": "episodes"}, libraries=("numpy",))
def measure(context: StageContext, *, episodes: ArtifactRef, config: MeasureConfig) -> None:
    """Write down the length of every episode."""
    lengths = EpisodeReader(context.store.open(episodes, "episodes")).lengths.tolist()
    (context.draft.path / "lengths.json").write_text(json.dumps(lengths))
    context.draft.summary |= {"episodes": len(lengths), "steps": sum(lengths)}
