"""Success rate of a policy on initial states that nothing else has seen."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Self

from pydantic import Field, model_validator

from juicer.artifacts.manifest import FINDING, HEADLINE, LABEL, OBSERVES, SHIFT, STATE
from juicer.artifacts.ref import ArtifactRef
from juicer.episode import Episode, Outcome
from juicer.evaluation import milestone_counts, wilson_interval
from juicer.policy_rollout import RolloutConfig, RolloutSection, roll_out
from juicer.seed_ranges import Purpose, claim
from juicer.shifts import Shift
from juicer.sim.env import gl_name
from juicer.storage.columns import DRAWN_BY
from juicer.storage.episodes import write_episodes
from juicer.storage.evaluations import EXAMPLES, EvaluationRow, write_evaluation
from juicer.tasks.registry import get_task
from juicer.text import printable
from stages.runtime.context import StageContext
from stages.runtime.stage import stage

EXAMPLES_KEPT = 3
"""Successes, and as many failures."""


class EvaluateSection(RolloutSection):
    """How many episodes, and from where they start, whatever the task."""

    episodes: int = Field(default=100, gt=0, le=1_000_000, description="evaluation episodes")


class EvaluateConfig(RolloutConfig, EvaluateSection):
    """How many episodes of a task, from where they start, and in what the scene differs from training."""

    shift: Shift | None = Field(default=None, description="in what the scene differs from training; nothing if empty")

    @model_validator(mode="after")
    def _shift_is_possible(self) -> Self:
        if self.shift:
            self.shift.check(self.randomness)
        return self


@stage(
    kind="evaluation",
    inputs={"checkpoint": "checkpoint"},
    libraries=("mujoco", "numpy", "torch", "zarr"),
)
def evaluate(context: StageContext, *, checkpoint: ArtifactRef, config: EvaluateConfig) -> None:
    """Measure a policy's success rate, with its interval and the milestones of every episode."""
    episodes = roll_out(
        context.store.open(checkpoint, "checkpoint"),
        checkpoint.id,
        config,
        claim(Purpose.EVALUATION, config.first, config.episodes),
        num_envs=context.machine.num_envs,
        num_workers=context.machine.workers,
        device=context.machine.device,
        shift=config.shift,
        progress=context.progress,
    )
    rows: list[EvaluationRow] = []
    examples = context.draft.path / EXAMPLES
    examples.mkdir()
    write_episodes(examples, _examples(episodes, rows), {"source": "rollout", "policy": checkpoint.id})
    write_evaluation(context.draft.path, rows)
    policy = context.store.manifest(checkpoint)
    context.draft.summary |= {OBSERVES: policy.observes} if policy.observes else {}
    context.draft.summary |= {SHIFT: config.shift.phrase} if config.shift else {}
    context.draft.summary |= facts(rows, get_task(config.task).milestones)
    context.draft.summary |= _texts(context.draft.summary)
    if finding := _other_renderer(policy.summary.get(DRAWN_BY, [])):
        context.draft.summary[FINDING] = finding


def _texts(summary: Mapping[str, Any]) -> dict[str, str]:
    """A rate is not told without its interval, nor without what the policy saw, and under which shift."""
    rate, low, high = (summary[name] for name in ("success_rate", "interval_low", "interval_high"))
    found = f"{rate:.0%} of {summary['episodes']} episodes"
    observes = summary.get(OBSERVES, STATE)
    seen = "" if observes == STATE else f", from {observes}"
    seen += f", {summary[SHIFT]}" if SHIFT in summary else ""
    return {HEADLINE: f"success {found} ({low:.0%} to {high:.0%}){seen}", LABEL: f"{found}{seen}"}


def _other_renderer(drawn_by: Sequence[str]) -> str:
    """A sentence if the policy acted on images that another renderer drew than those it learned from."""
    if not drawn_by or (present := gl_name()) in drawn_by:
        return ""
    return f"it acted on images drawn by {present}, and had learned from those of {printable(' and '.join(drawn_by))}"


def facts(rows: list[EvaluationRow], milestones: tuple[str, ...]) -> dict[str, object]:
    """What an evaluation found: the rate with its 95 % Wilson interval, outcomes, and how far the episodes got."""
    successes = sum(row.outcome is Outcome.SUCCESS for row in rows)
    low, high = wilson_interval(successes, len(rows))
    return {
        "episodes": len(rows),
        "successes": successes,
        "success_rate": successes / len(rows),
        "interval_low": low,
        "interval_high": high,
        "mean_length": sum(row.length for row in rows) / len(rows),
        "outcomes": dict(Counter(row.outcome.value for row in rows)),
        "milestones": milestone_counts([row.milestones for row in rows], milestones),
    }


def _examples(episodes: Iterable[Episode], rows: list[EvaluationRow]) -> Iterator[Episode]:
    """Note every episode as a row; yield the first few successes and failures."""
    shown = Counter[bool]()
    for index, episode in enumerate(episodes):
        rows.append(EvaluationRow.of(index, episode))
        succeeded = episode.record.outcome is Outcome.SUCCESS
        if shown[succeeded] < EXAMPLES_KEPT:
            shown[succeeded] += 1
            yield episode
