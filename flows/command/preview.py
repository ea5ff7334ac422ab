"""What a run would do: every stage call in order, reused or computed and why, and how long it may take."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from flows.config import RunConfig
from flows.running.plan import PlannedCall, explainer, plan
from flows.written import value_at
from juicer.artifacts.explain import Explanation
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore

REPORT = "report"
AMOUNTS: Mapping[str, Sequence[str]] = {
    "record": ("demonstrations",),
    "augment": ("num_snippets",),
    "train": ("training", "steps"),
    "collect": ("successes",),
    "evaluate": ("episodes",),
}
"""Where the settings of a stage say how much there is to do: it takes as much longer as that is more."""


@dataclass(frozen=True)
class PreviewedCall:
    """A stage call that the run would make.

    Attributes:
        stage: Name of the stage.
        task: The task of its run.
        label: Condition, seed and round that it is made for first, and the task where runs are for several.
        ref: The artifact; none for a report whose evaluations are not made yet.
        is_reused: Whether the artifact is in the store.
        reason: Why it would be computed: the first root of the miss; empty if it is reused.
        seconds: How long it took, or will if it takes its time like the most similar one; none if there was none.
        ends: Seconds from the beginning of its run to its end if nothing has to wait for a free worker; what is not
            known takes none.
    """

    stage: str
    task: str
    label: str
    ref: ArtifactRef | None
    is_reused: bool
    reason: str
    seconds: float | None
    ends: float


def preview(
    store: ArtifactStore, configs: Sequence[RunConfig], planned: Sequence[PlannedCall] | None = None
) -> list[list[PreviewedCall]]:
    """Every call of one run after the other, once; nothing is computed or written.

    A selection that is not made yet is assumed to keep something, so retraining is among the calls.

    Args:
        store: Where the artifacts are.
        configs: The runs.
        planned: Their calls, if they are planned already.
    """
    planned = planned or plan(store, *configs)
    explaining = explainer(store, planned)
    runs = []
    for config in configs:
        calls: list[PreviewedCall] = []
        ends: dict[ArtifactRef, float] = {}
        for entry in (entry for entry in planned if entry.config is config):
            explanation = explaining.explain(entry.call.recipe)
            seconds = _seconds(store, entry, explanation)
            begins = max((ends[ref] for ref in entry.call.recipe.parents if ref in ends), default=0.0)
            ends[entry.ref] = begins + (0.0 if entry.exists else seconds or 0.0)
            calls.append(
                PreviewedCall(
                    entry.stage,
                    config.task,
                    entry.label,
                    entry.ref,
                    entry.exists,
                    _reason(explanation),
                    seconds,
                    ends[entry.ref],
                )
            )
        if not any(call.stage == REPORT for call in calls):
            label = config.task if len(configs) > 1 else ""
            calls.append(_report(store, config.task, label, max(ends.values(), default=0.0)))
        runs.append(calls)
    return runs


def total_seconds(runs: Sequence[Sequence[PreviewedCall]], workers: int) -> float:
    """Least wall time of what is to be computed, as far as is known: by longest chains, and by all of the work."""
    return sum(
        max([sum(call.seconds or 0.0 for call in calls if not call.is_reused) / workers, *(c.ends for c in calls)])
        for calls in runs
    )


def _seconds(store: ArtifactStore, entry: PlannedCall, explanation: Explanation) -> float | None:
    if entry.exists:
        return store.manifest(entry.ref).seconds
    if explanation.nearest is None:
        return None
    before, now = _amount(explanation.nearest.recipe), _amount(entry.call.recipe)
    return explanation.nearest.seconds * (now / before if before and now else 1.0)


def _amount(recipe: Recipe) -> int | None:
    """How much there is to do; none if the settings do not say it, or are of a time when others did."""
    amount = value_at(recipe.config, AMOUNTS[recipe.stage]) if recipe.stage in AMOUNTS else None
    return amount if isinstance(amount, int) else None


def _reason(explanation: Explanation) -> str:
    if explanation.hit:
        return ""
    if explanation.nearest is None:
        return "the stage has made nothing before"
    if not explanation.causes:
        return "what it was made from differs"
    first, *rest = explanation.causes
    return first.phrase + (f", and {len(rest)} more" if rest else "")


def _report(store: ArtifactStore, task: str, label: str, begins: float) -> PreviewedCall:
    """The last call, whose recipe holds what the evaluations will find."""
    seconds = next((manifest.seconds for manifest in reversed(store.list(REPORT))), None)
    reason = "it tells of evaluations that are not made yet"
    return PreviewedCall(REPORT, task, label, None, False, reason, seconds, begins + (seconds or 0.0))
