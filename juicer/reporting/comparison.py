"""The comparison of conditions, read from evaluations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from juicer.artifacts.manifest import STATE
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.config import StrictConfig
from juicer.episode import Outcome
from juicer.errors import ArtifactError
from juicer.evaluation import ConditionResult, ModelResult, summarise
from juicer.reporting.setting import Setting
from juicer.storage.evaluations import read_evaluation


class ReportRow(StrictConfig):
    """Whose evaluation the one at the same place is.

    Attributes:
        condition: Name of the condition.
        title: What people read instead.
        seed: Seed of the model.
        shift: Name of the shift that it is under, if it is.
        unnoticed: Names of the shifts that the model cannot notice.
        setting: What the condition changes in the configuration.
        method: The condition that comes with juicer and has the same parts; empty if there is none.
    """

    condition: str
    title: str
    seed: int
    shift: str = ""
    unnoticed: tuple[str, ...] = ()
    setting: Setting = Setting()
    method: str = ""

    @property
    def label(self) -> str:
        """E.g. ``TA+CI, seed 0``."""
        return f"{self.title}, seed {self.seed}"


def condition_results(
    store: ArtifactStore, evaluations: Sequence[ArtifactRef], rows: Sequence[ReportRow]
) -> list[ConditionResult]:
    """Rows of the comparison, in the order in which the conditions first occur; each knows its results under shifts.

    Raises:
        ArtifactError: If an evaluation is missing, damaged or without an episode.
    """
    models: dict[str, dict[str, list[ModelResult]]] = {}
    stopped, observes = set(), dict[str, str]()
    for ref, row in zip(evaluations, rows, strict=True):
        table = read_evaluation(store.open(ref, "evaluation"))
        if not table:
            raise ArtifactError(f"{ref} holds no episode, so it says nothing about {row.label}; evaluate it again")
        result = ModelResult(
            seed=row.seed,
            initial_states=tuple(entry.seed for entry in table),
            successes=tuple(entry.outcome is Outcome.SUCCESS for entry in table),
        )
        models.setdefault(row.condition, {}).setdefault(row.shift, []).append(result)
        observes[row.condition] = store.manifest(ref).observes
        if store.recipe(ref).config.get("anytime") is True:
            stopped.add((row.condition, row.shift))
    titles = {row.condition: row.title for row in rows}
    unnoticed = {row.condition: dict.fromkeys(row.unnoticed) for row in rows}
    results = []
    for condition, by_shift in models.items():
        found = {
            shift: summarise(condition, each, titles[condition], anytime=(condition, shift) in stopped)
            for shift, each in by_shift.items()
        }
        usual = found.pop("")
        shifted = {**found, **unnoticed[condition]}
        results.append(replace(usual, shifted=shifted, observes=observes[condition]))
    return results


def by_observation(results: Sequence[ConditionResult]) -> dict[str, list[ConditionResult]]:
    """Results by what the policies saw, in words: those that share no table; empty for what is told poses."""
    groups: dict[str, list[ConditionResult]] = {}
    for result in results:
        groups.setdefault("" if result.observes == STATE else result.observes, []).append(result)
    return groups


def shift_names(results: Sequence[ConditionResult]) -> list[str]:
    """Names of all shifts that some condition was evaluated under, or cannot notice."""
    return list(dict.fromkeys(name for result in results for name in result.shifted))


def robustness_table(results: Sequence[ConditionResult]) -> tuple[list[str], list[list[str]]]:
    """Names of the columns, and rows: each condition's rate and its interval without a shift, and under each.

    Both are empty if there are no shifts.
    """
    names = shift_names(results)
    if not names:
        return [], []
    rows = [
        [row.title, _told(row, row), *(_told(row.shifted[name], row) if name in row.shifted else "-" for name in names)]
        for row in results
        if row.shifted
    ]
    return ["condition", "no shift", *names], rows


def _told(result: ConditionResult | None, usual: ConditionResult) -> str:
    if result is None:
        return "sees no images"
    low, high = result.interval
    told = f"{result.average:.0%} ({100 * low:.0f} to {high:.0%})"
    number, of_all = result.num_models, usual.num_models
    return told if number == of_all else f"{told}, {number} of {of_all} models"


def best_of(result: ConditionResult) -> str:
    """Rate of the best model, if there are several."""
    return f"{result.best:.0%}" if result.num_models > 1 else "-"


def markdown_table(results: Sequence[ConditionResult]) -> str:
    """Comparison in the form of the paper's Table VI, as Markdown, and a second table of the rates under shifts.

    Policies that observe different things stand in tables of their own.
    """
    return "\n".join(map(_markdown, by_observation(results).values()))


def _markdown(results: Sequence[ConditionResult]) -> str:
    lines = [
        "| condition | average | 95 % interval | best | models | episodes |",
        "|---|---:|---:|---:|---:|---:|",
    ]
    lines += [
        f"| {row.title} | {row.average:.0%} | {row.interval[0]:.0%} to {row.interval[1]:.0%} "
        f"| {best_of(row)} | {row.num_models} | {row.num_episodes} |"
        for row in results
    ]
    columns, rows = robustness_table(results)
    if columns:
        lines += ["", _line(columns), "|---|" + "---:|" * (len(columns) - 1), *map(_line, rows)]
    return "\n".join(lines) + "\n"


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"
