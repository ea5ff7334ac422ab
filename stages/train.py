"""A policy learns from episodes; retraining is the same with more of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from pydantic import Field

from juicer.artifacts.manifest import FINDING, OBSERVES
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.config import Seed, StrictConfig
from juicer.errors import ConfigError
from juicer.policy.config import FeatureSpec, PolicyConfig
from juicer.policy.feature_spec import feature_spec
from juicer.storage.columns import DRAWN_BY
from juicer.storage.curves import CurveWriter
from juicer.storage.dataset import DatasetRow, grouped, read_dataset
from juicer.storage.episodes import EpisodeReader
from juicer.tasks.registry import TASK_NAMES
from juicer.text import printable
from juicer.training.config import TrainingConfig
from juicer.training.images import Chosen, unpack_images
from juicer.training.reading import read_episodes
from juicer.training.windows import concatenate
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
    inputs={"dataset": "dataset", "estimators": "estimator", "start": "checkpoint"},
    libraries=("numpy", "torch"),
    noun="steps",
    counts="steps",
    headline=("steps", "train/loss", "validation/position_error_mm"),
    needs="devices",
)
def train(
    context: StageContext,
    *,
    dataset: ArtifactRef,
    estimators: tuple[ArtifactRef, ...] = (),
    start: ArtifactRef | None = None,
    config: TrainConfig,
) -> None:
    """Train a policy on the episodes of a dataset.

    If they show several tasks, it is one policy for all of them, which is told the task. Estimators are for policies
    that estimate poses: one for each of their tasks. With a checkpoint to start from, it goes on from its weights.
    """
    from juicer.policy.checkpoint import save_checkpoint  # torch takes seconds to import
    from juicer.policy.encoder import outline
    from juicer.training.ranks import current_ranks
    from juicer.training.trainer import train as train_policy

    rows = read_dataset(context.store.open(dataset, "dataset"))
    tasks = _tasks_of(rows)
    encoders = outline(config.policy, tasks)
    names = [spec.name for spec in encoders.training_numbers]
    groups = [Chosen(_open(context.store, group), group) for group in grouped(rows)]
    _require_own_estimates(context.store, rows, estimators)
    curves = CurveWriter(context.draft.scratch, context.metrics)
    episodes = concatenate([read_episodes(*group, tasks, names) for group in groups])
    images = context.draft.scratch / "images"
    trained = train_policy(
        [episodes],
        config.policy,
        tasks,
        config.training,
        seed=config.seed,
        estimators=[context.store.open(each, "estimator") for each in estimators],
        start=context.store.open(start, "checkpoint") if start else None,
        unpack=lambda: unpack_images(groups, encoders.training_images, images, context.progress),
        scratch=context.draft.scratch / "state",
        device=context.machine.device,
        loaders=context.machine.loaders,
        weights=context.machine.weights,
        progress=context.progress,
        metrics=curves,
    )
    if not current_ranks().leads:
        return
    save_checkpoint(context.draft.path, trained.checkpoint)
    curves.finish(context.draft.path)
    context.draft.summary |= {
        "tasks": list(tasks),
        OBSERVES: trained.observes,
        "steps": config.training.steps,
        **_sizes(trained.use),
        **trained.facts,
    }
    drawn_by = _drawn_by(context.store, (dataset, *estimators) if encoders.sees_images else ())
    if drawn_by:
        context.draft.summary[DRAWN_BY] = drawn_by
    findings = [*trained.losses, *_mixture(drawn_by)]
    if findings:
        context.draft.summary[FINDING] = "; ".join(findings)


def _tasks_of(rows: Sequence[DatasetRow]) -> dict[str, FeatureSpec]:
    """What a policy must know of each task, in the order of the registry, which gives tasks their numbers.

    Raises:
        ConfigError: If there is no such task.
    """
    shown = {row.task for row in rows}
    return {name: feature_spec(name) for name in sorted(shown, key=[*TASK_NAMES, *shown].index)}


def _open(store: ArtifactStore, rows: Sequence[DatasetRow]) -> EpisodeReader:
    """The artifact that some rows of a dataset are of."""
    columns = [store.open(ArtifactRef("columns", each)) for each in rows[0].columns]
    return EpisodeReader(store.open(ArtifactRef("episodes", rows[0].episodes)), columns)


def _require_own_estimates(store: ArtifactStore, rows: Sequence[DatasetRow], estimators: Sequence[ArtifactRef]) -> None:
    """Refuse to learn from what another estimator has seen than the one that the policy will act with.

    Raises:
        ConfigError: If a column was made with an estimator that is not given.
    """
    for ref in dict.fromkeys(ArtifactRef("columns", each) for row in rows for each in row.columns):
        for other in set(store.manifest(ref).recipe.inputs.get("estimators", ())) - set(estimators):
            raise ConfigError(
                f"{ref} holds what {other} reads off images, and the policy is not given that estimator to act with; "
                "give it, or make the columns again by the stage 'encode' with the estimators that are given"
            )


def _drawn_by(store: ArtifactStore, seen: Sequence[ArtifactRef]) -> list[str]:
    """What drew the images behind some artifacts, in the words of OpenGL platforms."""
    return sorted({each for ref in seen for each in store.manifest(ref).summary.get(DRAWN_BY, [])})


def _mixture(drawn_by: Sequence[str]) -> list[str]:
    """A sentence if images come from several renderers."""
    several = " and others by ".join(map(printable, drawn_by))
    return [f"some of its images were drawn by {several}; draw all of them by one"] if len(drawn_by) > 1 else []


def _sizes(use: Mapping[str, SourceUse]) -> dict[str, dict[str, int]]:
    """Size of the data by source, in the form of the paper's Table V, and what the windows make of it."""
    counts = ("episodes", "timesteps", "windows", "validation_windows", "unused_episodes", "unused_timesteps")
    return {name: {source: getattr(counted, name) for source, counted in use.items()} for name in counts}
