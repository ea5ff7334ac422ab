"""Success rate of a policy on initial states that nothing else has seen."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from itertools import chain
from pathlib import Path
from typing import Any, Self

from pydantic import Field, model_validator

from juicer.artifacts.manifest import HEADLINE, LABEL, OBSERVES, SHIFT, STATE
from juicer.artifacts.ref import ArtifactRef
from juicer.episode import Episode, Outcome
from juicer.errors import ConfigError
from juicer.evaluation import anytime_interval, milestone_counts, wilson_interval
from juicer.policy_rollout import RolloutConfig, RolloutSection, roll_out
from juicer.renderers import renderer_facts
from juicer.seed_ranges import Purpose, claim
from juicer.shifts import Shift
from juicer.storage.episodes import EpisodeReader, write_episodes
from juicer.storage.evaluations import EXAMPLES, EvaluationRow, read_evaluation, write_evaluation
from juicer.tasks.registry import get_task
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
    anytime: bool = Field(
        default=False,
        description="whether more episodes may follow, depending on what is found, so that its interval must hold "
        "however often one looks",
    )

    @model_validator(mode="after")
    def _shift_is_possible(self) -> Self:
        if self.shift:
            self.shift.check(self.randomness)
        return self


@stage(
    kind="evaluation",
    inputs={"checkpoint": "checkpoint", "previous": "evaluation"},
    libraries=("mujoco", "numpy", "torch", "zarr"),
)
def evaluate(
    context: StageContext, *, checkpoint: ArtifactRef, previous: ArtifactRef | None = None, config: EvaluateConfig
) -> None:
    """Measure a policy's success rate, with its interval and the milestones of every episode.

    With a previous evaluation of fewer episodes, it begins with these and runs only the rest.
    """
    rows, kept = _begun(context, checkpoint, previous, config)
    episodes = roll_out(
        context.store.open(checkpoint, "checkpoint"),
        checkpoint.id,
        config,
        claim(Purpose.EVALUATION, config.first, config.episodes)[len(rows) :],
        num_envs=context.machine.num_envs,
        num_workers=context.machine.workers,
        device=context.machine.device,
        shift=config.shift,
        progress=context.progress,
    )
    examples = context.draft.path / EXAMPLES
    examples.mkdir()
    shown = _examples(chain(kept, _noted(episodes, rows)))
    write_episodes(examples, shown, {"source": "rollout", "policy": checkpoint.id})
    write_evaluation(context.draft.path, rows)
    policy = context.store.manifest(checkpoint)
    context.draft.summary |= {OBSERVES: policy.observes} if policy.observes else {}
    context.draft.summary |= facts(rows, get_task(config.task).milestones, anytime=config.anytime)
    context.draft.summary |= {SHIFT: config.shift.phrase} if config.shift else {}
    context.draft.summary |= _texts(context.draft.summary)
    context.draft.summary |= renderer_facts(context.store, checkpoint, previous)


def _texts(summary: Mapping[str, Any]) -> dict[str, str]:
    """A rate is not told without its interval, nor without what the policy saw, and under which shift."""
    rate, low, high = (summary[name] for name in ("success_rate", "interval_low", "interval_high"))
    found = f"{rate:.0%} of {summary['episodes']} episodes"
    observes = summary.get(OBSERVES, STATE)
    seen = "" if observes == STATE else f", from {observes}"
    seen += f", {summary[SHIFT]}" if SHIFT in summary else ""
    return {HEADLINE: f"success {found} ({low:.0%} to {high:.0%}){seen}", LABEL: f"{found}{seen}"}


def facts(rows: list[EvaluationRow], milestones: tuple[str, ...], *, anytime: bool = False) -> dict[str, object]:
    """What an evaluation found: the rate with its 95 % interval, outcomes, and how far the episodes got.

    The interval is Wilson's, or with ``anytime`` one that holds although their number depends on what was found.
    """
    successes = sum(row.outcome is Outcome.SUCCESS for row in rows)
    low, high = (anytime_interval if anytime else wilson_interval)(successes, len(rows))
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


def _begun(
    context: StageContext, checkpoint: ArtifactRef, previous: ArtifactRef | None, config: EvaluateConfig
) -> tuple[list[EvaluationRow], Iterator[Episode]]:
    """Rows of the previous evaluation, if there is one, and the episodes that it kept.

    Raises:
        ConfigError: If it was of another checkpoint, from other initial states, or longer.
    """
    if previous is None:
        return [], iter(())
    recipe = context.store.recipe(previous)
    rows = read_evaluation(folder := context.store.open(previous, "evaluation"))
    settings = {**recipe.config, "episodes": config.episodes}
    is_same = recipe.inputs.get("checkpoint") == (checkpoint,) and settings == config.model_dump(mode="json")
    if not is_same or len(rows) >= config.episodes:
        raise ConfigError(f"{previous} is not the beginning of {config.episodes} such episodes of {checkpoint}")
    return rows, _kept(folder)


def _kept(evaluation: Path) -> Iterator[Episode]:
    reader = EpisodeReader(evaluation / EXAMPLES)
    return map(reader.read, range(len(reader.records)))


def _noted(episodes: Iterable[Episode], rows: list[EvaluationRow]) -> Iterator[Episode]:
    """Note every episode as a row."""
    for episode in episodes:
        rows.append(EvaluationRow.of(len(rows), episode))
        yield episode


def _examples(episodes: Iterable[Episode]) -> Iterator[Episode]:
    """The first few successes and failures; looks at every episode."""
    shown = Counter[bool]()
    for episode in episodes:
        succeeded = episode.record.outcome is Outcome.SUCCESS
        if shown[succeeded] < EXAMPLES_KEPT:
            shown[succeeded] += 1
            yield episode
