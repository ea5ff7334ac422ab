"""Corrective episodes of an operator, grown from rollouts that failed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator

from pydantic import Field

from juicer.artifacts.manifest import FINDING
from juicer.artifacts.ref import ArtifactRef
from juicer.config import Seed
from juicer.demonstration.correction import Correction, CorrectionConfig
from juicer.demonstration.correction import correct as correct_rollouts
from juicer.episode import Episode, Outcome
from juicer.expert.operator import DEVICE, scripted_operators
from juicer.storage.episodes import EpisodeReader, write_episodes
from stages.runtime.context import StageContext
from stages.runtime.stage import stage


class CorrectConfig(CorrectionConfig):
    """When the scripted operator takes over, how often, and with which habits."""

    seed: Seed = Field(default=0, description="root of the operator's habits")


@stage(
    kind="episodes",
    inputs={"episodes": "episodes"},
    libraries=("mujoco", "numpy", "zarr"),
    noun="corrections",
    counts="corrections",
    headline=("corrections", "attempts", "human_steps"),
)
def correct(context: StageContext, *, episodes: ArtifactRef, config: CorrectConfig) -> None:
    """Let the scripted operator take over where rollouts got stuck, and keep what it finishes."""
    rollouts = EpisodeReader(context.store.open(episodes, "episodes"))
    rollouts.require_state()
    tried, kept = Counter[str](), Counter[str]()
    steps = Counter[str]()

    def finished(attempts: Iterable[Correction]) -> Iterator[Episode]:
        for attempt in attempts:
            stuck = attempt.milestone or "start"
            tried[stuck] += 1
            steps["human"] += attempt.human_steps
            if attempt.episode.record.outcome is Outcome.SUCCESS:
                kept[stuck] += 1
                steps["kept"] += len(attempt.episode)
                yield attempt.episode

    attempts = correct_rollouts(
        rollouts,
        scripted_operators(config.seed),
        config,
        num_workers=context.machine.workers,
        progress=context.progress,
    )
    # Attempts that all failed are not made again.
    write_episodes(context.draft.path, finished(attempts), {"source": "correction"}, may_be_empty=True)
    context.draft.summary |= {
        "episodes": kept.total(),
        "corrections": kept.total(),
        "attempts": tried.total(),
        "share": kept.total() / tried.total() if tried else 0.0,
        "steps": steps["kept"],
        "human_steps": steps["human"],
        "device": DEVICE,
        "by_milestone": {name: {"attempts": count, "corrections": kept[name]} for name, count in tried.items()},
    }
    if not kept:
        context.draft.summary[FINDING] = (
            f"no correction: the operator finished none of {tried.total()} failed rollouts in {episodes}"
            if tried
            else f"no correction: no rollout in {episodes} failed"
        )
