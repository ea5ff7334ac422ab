"""The rollouts worth imitating."""

from __future__ import annotations

import math
from statistics import median

from pydantic import Field

from juicer.artifacts.manifest import FINDING
from juicer.artifacts.ref import ArtifactRef
from juicer.config import StrictConfig
from juicer.episode import Outcome
from juicer.errors import NothingLeft
from juicer.shifts import require_unshifted
from juicer.storage.episodes import EpisodeReader
from juicer.storage.selections import SelectionRow, write_selection
from stages.runtime.context import StageContext
from stages.runtime.stage import stage


class SelectConfig(StrictConfig):
    """Which rollouts are kept.

    A policy that hesitates and succeeds all the same, retrained on that, hesitates more.
    """

    longest: float | None = Field(
        default=1.25,
        ge=1,
        le=1000,
        description="in lengths of the median success: longer ones dawdle; no limit if empty",
    )
    max_episodes: int | None = Field(
        default=None, gt=0, le=10_000_000, description="at most this many, the first ones; all if empty"
    )


@stage(
    kind="selection",
    inputs={"episodes": "episodes"},
    noun="kept",
    counts="kept",
    headline=("episodes", "kept", "steps"),
)
def select(context: StageContext, *, episodes: ArtifactRef, config: SelectConfig) -> None:
    """Keep the successful rollouts that did not dawdle; the arrays stay where they are."""
    reader = EpisodeReader(context.store.open(episodes, "episodes"))
    require_unshifted(reader.records, str(episodes))
    limit = _longest(reader, config)
    if not len(reader):
        raise NothingLeft(f"there is nothing to select from: {episodes} holds no episode")
    rows: list[SelectionRow] = []
    kept = steps = 0
    for record, length in zip(reader.records, reader.lengths, strict=True):
        if record.outcome is not Outcome.SUCCESS:
            rows.append(SelectionRow(record.episode_id, keep=False, reason=record.outcome.value))
        elif length > limit:
            rows.append(
                SelectionRow(record.episode_id, keep=False, reason=f"dawdled, it took more than {limit:.0f} steps")
            )
        elif kept == config.max_episodes:
            rows.append(SelectionRow(record.episode_id, keep=False, reason="enough successes before it"))
        else:
            rows.append(SelectionRow(record.episode_id, keep=True, reason=record.outcome.value))
            kept += 1
            steps += int(length)
    write_selection(context.draft.path, rows)
    context.draft.summary |= {"episodes": len(rows), "kept": kept, "rate": kept / len(rows), "steps": steps}
    if not kept:
        context.draft.summary[FINDING] = (
            f"no successful rollout to retrain on: none of {len(rows)} in {episodes} succeeded"
        )


def _longest(reader: EpisodeReader, config: SelectConfig) -> float:
    """Steps above which a success dawdles."""
    successes = [
        int(length)
        for length, record in zip(reader.lengths, reader.records, strict=True)
        if record.outcome is Outcome.SUCCESS
    ]
    if config.longest is None or not successes:
        return math.inf
    return config.longest * median(successes)
