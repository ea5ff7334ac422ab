"""The rollouts worth imitating."""

from __future__ import annotations

from pydantic import Field

from juicer.artifacts.ref import ArtifactRef
from juicer.config import StrictConfig
from juicer.episode import Outcome
from juicer.errors import NothingLeft
from juicer.storage.episodes import EpisodeReader
from juicer.storage.tables import SelectionRow, write_selection
from stages.stage import StageContext, stage


class SelectConfig(StrictConfig):
    """Which rollouts are kept."""

    max_episodes: int | None = Field(default=None, gt=0, description="at most this many, the first ones; all if empty")


@stage(kind="selection", inputs={"episodes": "episodes"})
def select(context: StageContext, *, episodes: ArtifactRef, config: SelectConfig) -> None:
    """Keep the successful rollouts; the arrays stay where they are."""
    reader = EpisodeReader(context.store.open(episodes, "episodes"))
    rows: list[SelectionRow] = []
    kept = steps = 0
    for index, record in enumerate(reader.records):
        if record.outcome is not Outcome.SUCCESS:
            rows.append(SelectionRow(index, keep=False, reason=record.outcome.value))
        elif kept == config.max_episodes:
            rows.append(SelectionRow(index, keep=False, reason="enough successes before it"))
        else:
            rows.append(SelectionRow(index, keep=True, reason=record.outcome.value))
            kept += 1
            steps += int(reader.lengths[index])
    if not kept:
        raise NothingLeft(f"no successful rollout to retrain on: none of {len(rows)} in {episodes} succeeded")
    write_selection(context.draft.path, rows)
    context.draft.summary |= {"episodes": len(rows), "kept": kept, "rate": kept / len(rows), "steps": steps}
