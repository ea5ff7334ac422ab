"""The baseline that learns nothing: demonstrations to be replayed without looking."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from juicer.artifacts.ref import ArtifactRef
from juicer.config import StrictConfig
from juicer.policy.replay import ReplayPolicy
from juicer.storage.episodes import EpisodeReader
from juicer.tasks.registry import get_task
from stages.stage import StageContext, stage


class MemoriseConfig(StrictConfig):
    """What the demonstrations are of."""

    task: str = Field(default="one_leg", description="assembly task")


@stage(kind="checkpoint", inputs={"episodes": "episodes"}, libraries=("numpy",))
def memorise(context: StageContext, *, episodes: ArtifactRef, config: MemoriseConfig) -> None:
    """Keep the demonstrations' actions as a policy that plays them open loop."""
    task = get_task(config.task)
    reader = EpisodeReader(context.store.open(episodes, "episodes"))
    starts = reader.episode_ends - reader.lengths
    parts = sorted({part for pair in task.pairs for part in (pair.first, pair.second)})
    actions = np.split(reader.steps("action"), starts[1:])
    ReplayPolicy(reader.steps("part_poses")[starts], actions, parts, task.max_steps).save(context.draft.path)
    context.draft.summary |= {
        "tasks": [task.name],
        "episodes": {"teleop": len(reader)},
        "timesteps": {"teleop": int(reader.lengths.sum())},
    }
