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
from juicer.expert.steady import Steady
from juicer.expert.temperament import Temperament
from juicer.storage.episodes import EpisodeReader, write_episodes
from stages.runtime.context import StageContext
from stages.runtime.stage import stage


class CorrectSection(CorrectionConfig):
    """When the scripted operator takes over, how often, and with which habits."""

    seed: Seed = Field(default=0, description="root of the operator's habits")
    temperament: Temperament | None = Field(
        default=None, description="how unlike a machine the operator is; as in the recordings if empty"
    )


class CorrectConfig(CorrectSection):
    """The same, whoever recorded."""

    temperament: Temperament = Field(default=Steady(), description="how unlike a machine the operator is")


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
    attempts = correct_rollouts(
        rollouts,
        scripted_operators(config.seed, config.temperament),
        config,
        num_workers=context.machine.workers,
        progress=context.progress,
    )
    tally = _Tally()
    # Attempts that all failed are not made again.
    write_episodes(context.draft.path, tally.keep(attempts), {"source": "correction"}, may_be_empty=True)
    context.draft.summary |= tally.facts()
    if finding := tally.why_nothing(episodes):
        context.draft.summary[FINDING] = finding


class _Tally:
    """Counts attempts as they pass by, by the milestone that the policy had reached."""

    def __init__(self) -> None:
        self._tried: Counter[str] = Counter()
        self._kept: Counter[str] = Counter()
        self._human_steps = self._steps = 0

    def keep(self, attempts: Iterable[Correction]) -> Iterator[Episode]:
        """Yield the episodes of those that succeeded."""
        for attempt in attempts:
            stuck = attempt.milestone or "start"
            self._tried[stuck] += 1
            self._human_steps += attempt.human_steps
            if attempt.episode.record.outcome is Outcome.SUCCESS:
                self._kept[stuck] += 1
                self._steps += len(attempt.episode)
                yield attempt.episode

    def facts(self) -> dict[str, object]:
        """A human's time counts for attempts that failed, too."""
        tried, kept = self._tried.total(), self._kept.total()
        return {
            "episodes": kept,
            "corrections": kept,
            "attempts": tried,
            "share": kept / tried if tried else 0.0,
            "steps": self._steps,
            "human_steps": self._human_steps,
            "device": DEVICE,
            "by_milestone": {
                name: {"attempts": count, "corrections": self._kept[name]} for name, count in self._tried.items()
            },
        }

    def why_nothing(self, rollouts: ArtifactRef) -> str:
        """In a sentence, why there is no correction; empty if there is one."""
        if self._kept:
            return ""
        if not self._tried:
            return f"no correction: no rollout in {rollouts} failed"
        return f"no correction: the operator finished none of {self._tried.total()} failed rollouts in {rollouts}"
