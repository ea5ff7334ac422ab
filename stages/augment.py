"""Corrective episodes around critical states."""

from __future__ import annotations

from pydantic import Field

from juicer.artifacts.manifest import FINDING
from juicer.artifacts.ref import ArtifactRef
from juicer.augmentation.augment import augment as augment_demonstrations
from juicer.augmentation.config import AugmentationConfig
from juicer.augmentation.summary import AugmentationSummary
from juicer.config import Seed
from juicer.storage.annotations import read_annotations
from juicer.storage.episodes import EpisodeReader, write_episodes
from juicer.tasks.registry import get_task
from stages.runtime.context import StageContext
from stages.runtime.stage import stage


class AugmentConfig(AugmentationConfig):
    """What to synthesise, and from which root of randomness."""

    seed: Seed = Field(default=0, description="root of the random draws")


@stage(
    kind="episodes",
    inputs={"episodes": "episodes", "annotations": "annotations", "rollouts": "episodes"},
    libraries=("mujoco", "numpy", "scipy", "zarr"),
    noun="snippets",
    counts="snippets",
    headline=("yield", "snippets"),
)
def augment(
    context: StageContext,
    *,
    episodes: ArtifactRef,
    annotations: ArtifactRef,
    rollouts: tuple[ArtifactRef, ...] = (),
    config: AugmentConfig,
) -> None:
    """Grow demonstrations around their critical states; rollouts tell a placement by coverage where policies fail."""
    demonstrations = EpisodeReader(context.store.open(episodes, "episodes"))
    demonstrations.require_state()
    ranges = AugmentationConfig(**{name: getattr(config, name) for name in AugmentationConfig.model_fields})
    attempts = augment_demonstrations(
        demonstrations,
        read_annotations(context.store.open(annotations, "annotations")),
        ranges,
        seed=config.seed,
        rollouts=[EpisodeReader(context.store.open(ref, "episodes")) for ref in rollouts],
        num_workers=context.machine.workers,
        progress=context.progress,
    )
    task = get_task(demonstrations.records[0].task)
    summary = AugmentationSummary([task.name_of(state) for state in (*task.critical_states, *task.further_states)])
    # Hundreds of attempts without a snippet are not made again.
    write_episodes(context.draft.path, summary.keep(attempts), {"source": "augmentation"}, may_be_empty=True)
    facts = summary.as_json()
    context.draft.summary |= {"episodes": facts["snippets"], **facts}
    if finding := summary.why_nothing(ranges):
        context.draft.summary[FINDING] = finding
