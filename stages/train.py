"""A policy learns from episodes; retraining is the same with more of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from juicer.artifacts.ref import ArtifactRef
from juicer.config import StrictConfig
from juicer.episode import OBSERVATION_KEYS, EpisodeRecord, Source
from juicer.policy.config import FeatureSpec, PairSpec, PolicyConfig
from juicer.storage.curves import CurveWriter
from juicer.storage.episodes import EpisodeReader
from juicer.storage.tables import read_selection
from juicer.tasks.registry import get_task
from juicer.training.config import TrainingConfig
from juicer.training.windows import TrainingEpisodes
from stages.stage import StageContext, stage


class TrainConfig(StrictConfig):
    """What to train, and how."""

    task: str = Field(default="one_leg", description="assembly task")
    policy: PolicyConfig = PolicyConfig()
    training: TrainingConfig = TrainingConfig()
    seed: int = Field(default=0, ge=0, description="root of initial weights, split, order and noise")


@stage(
    kind="checkpoint",
    inputs={"episodes": "episodes", "selections": "selection"},
    libraries=("numpy", "torch"),
)
def train(
    context: StageContext,
    *,
    episodes: tuple[ArtifactRef, ...],
    selections: tuple[ArtifactRef, ...] = (),
    config: TrainConfig,
) -> None:
    """Train a policy on whole artifacts of episodes and on the kept episodes of selections."""
    from juicer.policy.checkpoint import save_checkpoint  # torch takes seconds to import
    from juicer.training.trainer import train as train_policy

    sources = [_source(context.store.open(ref, "episodes"), ref.id, None) for ref in episodes]
    for ref in selections:
        (origin,) = context.store.manifest(ref).recipe.inputs["episodes"]
        kept = [row.episode for row in read_selection(context.store.open(ref, "selection")) if row.keep]
        sources.append(_source(context.store.open(origin, "episodes"), origin.id, kept))
    curves = CurveWriter(context.draft.scratch, context.metrics)
    trained = train_policy(
        [source.episodes for source in sources],
        config.policy,
        feature_spec(config.task),
        config.training,
        seed=config.seed,
        scratch=context.draft.scratch / "state",
        device=context.device,
        progress=context.progress,
        metrics=curves,
    )
    save_checkpoint(context.draft.path, trained.checkpoint)
    curves.finish(context.draft.path)
    context.draft.summary |= {"steps": config.training.steps, **_dataset(sources), **trained.facts}


def feature_spec(task_name: str) -> FeatureSpec:
    """The numbers of a task that its features need."""
    task = get_task(task_name)
    pairs = tuple(
        PairSpec(first=pair.first, second=pair.second, target=pair.targets[pair.operator_target]) for pair in task.pairs
    )
    return FeatureSpec(num_parts=len(task.parts), pairs=pairs)


class _Source:
    """Episodes to learn from, with what they are."""

    def __init__(self, episodes: TrainingEpisodes, records: list[EpisodeRecord]) -> None:
        self.episodes = episodes
        self.records = records


def _source(folder: Path, artifact: str, kept: list[int] | None) -> _Source:
    reader = EpisodeReader(folder)
    chosen = list(range(len(reader))) if kept is None else kept
    steps = _steps_of(reader, chosen)
    records = [reader.records[index] for index in chosen]
    return _Source(
        TrainingEpisodes(
            observations={key: reader.steps(key)[steps] for key in OBSERVATION_KEYS},
            actions=reader.steps("action")[steps],
            episode_ends=np.cumsum(reader.lengths[chosen]),
            # A snippet goes with the demonstration it was grown from, lest one validates the other.
            families=[record.parent or f"{artifact}/{index}" for index, record in zip(chosen, records, strict=True)],
        ),
        records,
    )


def _steps_of(reader: EpisodeReader, chosen: list[int]) -> NDArray[np.int64]:
    starts = reader.episode_ends - reader.lengths
    return np.concatenate([np.arange(starts[index], reader.episode_ends[index]) for index in chosen])


def _dataset(sources: list[_Source]) -> dict[str, object]:
    """Size of the data by source, in the form of the paper's Table V."""
    episodes: dict[Source, int] = {}
    timesteps: dict[Source, int] = {}
    for source in sources:
        lengths = np.diff(source.episodes.episode_ends, prepend=0)
        for record, length in zip(source.records, lengths, strict=True):
            episodes[record.source] = episodes.get(record.source, 0) + 1
            timesteps[record.source] = timesteps.get(record.source, 0) + int(length)
    return {"episodes": episodes, "timesteps": timesteps}
