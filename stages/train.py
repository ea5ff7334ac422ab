"""A policy learns from episodes; retraining is the same with more of them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from juicer.artifacts.manifest import FINDING
from juicer.artifacts.ref import ArtifactRef
from juicer.config import Seed, StrictConfig
from juicer.episode import OBSERVATION_KEYS
from juicer.errors import NothingLeft
from juicer.policy.config import FeatureSpec, PairSpec, PolicyConfig
from juicer.policy.tasks import Tasks, as_shown
from juicer.storage.curves import CurveWriter
from juicer.storage.episodes import EpisodeReader
from juicer.storage.tables import read_selection
from juicer.tasks.registry import TASK_NAMES, get_task
from juicer.tasks.specification import MOUNTED_COSINE, MOUNTED_M
from juicer.training.config import TrainingConfig
from juicer.training.windows import TrainingEpisodes
from stages.runtime.context import StageContext
from stages.runtime.stage import stage

if TYPE_CHECKING:
    from juicer.training.use import SourceUse


class TrainConfig(StrictConfig):
    """What to train, and how."""

    policy: PolicyConfig = PolicyConfig()
    training: TrainingConfig = TrainingConfig()
    seed: Seed = Field(default=0, description="root of initial weights, split, order and noise")


@stage(
    kind="checkpoint",
    inputs={"episodes": "episodes", "selections": "selection"},
    libraries=("numpy", "torch"),
    noun="steps",
    counts="steps",
    headline=("steps", "train/loss", "validation/position_error_mm"),
    shows_as="model",
    needs="device",
)
def train(
    context: StageContext,
    *,
    episodes: tuple[ArtifactRef, ...],
    selections: tuple[ArtifactRef, ...] = (),
    config: TrainConfig,
) -> None:
    """Train a policy on whole artifacts of episodes and on the kept episodes of selections.

    If they show several tasks, it is one policy for all of them, which is told the task.
    """
    from juicer.policy.checkpoint import save_checkpoint  # torch takes seconds to import
    from juicer.training.trainer import train as train_policy

    sources = [_Source(context.store.open(ref, "episodes"), ref.id, None) for ref in episodes]
    for ref in selections:
        (origin,) = context.store.manifest(ref).recipe.inputs["episodes"]
        kept = [row.episode for row in read_selection(context.store.open(ref, "selection")) if row.keep]
        sources.append(_Source(context.store.open(origin, "episodes"), origin.id, kept))
    shown = {source.task for source in sources}
    tasks = {name: feature_spec(name) for name in TASK_NAMES if name in shown}
    curves = CurveWriter(context.draft.scratch, context.metrics)
    trained = train_policy(
        [source.read(tasks) for source in sources],
        config.policy,
        tasks,
        config.training,
        seed=config.seed,
        scratch=context.draft.scratch / "state",
        device=context.machine.device,
        progress=context.progress,
        metrics=curves,
    )
    save_checkpoint(context.draft.path, trained.checkpoint)
    curves.finish(context.draft.path)
    context.draft.summary |= {
        "tasks": list(tasks),
        "steps": config.training.steps,
        **_dataset(trained.use),
        **trained.facts,
    }
    if trained.losses:
        context.draft.summary[FINDING] = "; ".join(trained.losses)


def feature_spec(task_name: str) -> FeatureSpec:
    """The numbers of a task that its features need."""
    task = get_task(task_name)
    pairs = tuple(
        PairSpec(
            first=pair.first,
            second=pair.second,
            target=pair.targets[pair.operator_target],
            also_at=tuple(target for index, target in enumerate(pair.targets) if index != pair.operator_target),
            any_rotation=pair.any_rotation,
        )
        for pair in task.pairs
    )
    return FeatureSpec(num_parts=len(task.parts), pairs=pairs, mounted_m=MOUNTED_M, mounted_cosine=MOUNTED_COSINE)


class _Source:
    """Episodes of one task to learn from."""

    def __init__(self, folder: Path, artifact: str, kept: list[int] | None) -> None:
        self._reader = EpisodeReader(folder)
        self._artifact = artifact
        self._chosen = list(range(len(self._reader))) if kept is None else kept
        if not self._chosen:
            raise NothingLeft(f"episodes/{artifact} holds nothing to learn from; leave it out")
        self.records = [self._reader.records[index] for index in self._chosen]
        self.lengths = self._reader.lengths[self._chosen]
        self.task = self.records[0].task

    def read(self, tasks: Tasks) -> TrainingEpisodes:
        """The episodes, for a policy that learns these tasks."""
        reader = self._reader
        starts = reader.episode_ends - reader.lengths
        steps = np.concatenate([np.arange(starts[index], reader.episode_ends[index]) for index in self._chosen])
        return TrainingEpisodes(
            observations=as_shown({key: reader.steps(key)[steps] for key in OBSERVATION_KEYS}, tasks, self.task),
            actions=reader.steps("action")[steps],
            episode_ends=np.cumsum(self.lengths),
            # A snippet goes with the demonstration it was grown from, lest one validates the other.
            families=[
                record.parent or f"{self._artifact}/{index}"
                for index, record in zip(self._chosen, self.records, strict=True)
            ],
            sources=[record.source.value for record in self.records],
        )


def _dataset(use: Mapping[str, SourceUse]) -> dict[str, dict[str, int]]:
    """Size of the data by source, in the form of the paper's Table V, and what the windows make of it."""
    counts = ("episodes", "timesteps", "windows", "validation_windows", "unused_episodes", "unused_timesteps")
    return {name: {source: getattr(counted, name) for source, counted in use.items()} for name in counts}
