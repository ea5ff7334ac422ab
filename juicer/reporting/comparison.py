"""The comparison of conditions, read from evaluations."""

from __future__ import annotations

from collections.abc import Sequence

from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.config import StrictConfig
from juicer.episode import Outcome
from juicer.errors import ArtifactError
from juicer.evaluation import ConditionResult, ModelResult, summarise
from juicer.storage.evaluations import read_evaluation


class ReportRow(StrictConfig):
    """Whose evaluation the one at the same place is.

    Attributes:
        condition: Name of the condition.
        title: What people read instead.
        seed: Seed of the model.
        setting: What the condition changes in the configuration, in words; empty if nothing.
    """

    condition: str
    title: str
    seed: int
    setting: str = ""

    @property
    def label(self) -> str:
        """E.g. ``TA+CI, seed 0``."""
        return f"{self.title}, seed {self.seed}"


def condition_results(
    store: ArtifactStore, evaluations: Sequence[ArtifactRef], rows: Sequence[ReportRow]
) -> list[ConditionResult]:
    """Rows of the comparison, in the order in which the conditions first occur.

    Raises:
        ArtifactError: If an evaluation is missing, damaged or without an episode.
    """
    models: dict[str, list[ModelResult]] = {}
    for ref, row in zip(evaluations, rows, strict=True):
        table = read_evaluation(store.open(ref, "evaluation"))
        if not table:
            raise ArtifactError(f"{ref} holds no episode, so it says nothing about {row.label}; evaluate it again")
        result = ModelResult(
            seed=row.seed,
            initial_states=tuple(entry.seed for entry in table),
            successes=tuple(entry.outcome is Outcome.SUCCESS for entry in table),
        )
        models.setdefault(row.condition, []).append(result)
    titles = {row.condition: row.title for row in rows}
    return [summarise(condition, results, titles[condition]) for condition, results in models.items()]


def markdown_table(results: Sequence[ConditionResult]) -> str:
    """Comparison in the form of the paper's Table VI, as Markdown."""
    lines = [
        "| condition | average | 95 % interval | best | models | episodes |",
        "|---|---:|---:|---:|---:|---:|",
    ]
    lines += [
        f"| {row.title} | {row.average:.0%} | {row.interval[0]:.0%} to {row.interval[1]:.0%} "
        f"| {row.best:.0%} | {row.num_models} | {row.num_episodes} |"
        for row in results
    ]
    return "\n".join(lines) + "\n"
