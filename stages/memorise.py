"""The baseline that learns nothing: demonstrations to be replayed without looking."""

from __future__ import annotations

import numpy as np

from juicer.artifacts.manifest import OBSERVES, STATE
from juicer.artifacts.ref import ArtifactRef
from juicer.config import StrictConfig
from juicer.errors import NothingLeft
from juicer.policy.replay import ReplayPolicy
from juicer.shifts import require_unshifted
from juicer.storage.episodes import EpisodeReader
from juicer.tasks.registry import get_task
from stages.runtime.context import StageContext
from stages.runtime.stage import stage


class MemoriseConfig(StrictConfig):
    """Nothing to choose: the demonstrations say themselves what they are of."""


@stage(kind="checkpoint", inputs={"episodes": "episodes"}, libraries=("numpy",))
def memorise(context: StageContext, *, episodes: ArtifactRef, config: MemoriseConfig) -> None:
    """Keep the demonstrations' actions as a policy that plays them open loop."""
    reader = EpisodeReader(context.store.open(episodes, "episodes"))
    if not len(reader):
        raise NothingLeft(f"there is nothing to replay: {episodes} holds no episode")
    require_unshifted(reader.records, str(episodes))
    task = get_task(reader.records[0].task)
    starts = reader.episode_ends - reader.lengths
    actions = np.split(reader.steps("action"), starts[1:])
    policy = ReplayPolicy(reader.steps("part_poses")[starts], actions, task.assembled_parts, task.max_steps)
    policy.save(context.draft.path, task.name)
    context.draft.summary |= {
        "tasks": [task.name],
        OBSERVES: STATE,
        "episodes": {"teleop": len(reader)},
        "timesteps": {"teleop": int(reader.lengths.sum())},
    }
