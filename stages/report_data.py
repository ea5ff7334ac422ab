"""What a report says, read from the evaluations and from everything they were made from."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from statistics import fmean
from typing import Any

import numpy as np

from juicer.artifacts.manifest import Manifest
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.config import StrictConfig
from juicer.episode import Outcome
from juicer.errors import ArtifactError, ConfigError
from juicer.evaluation import PAPER_TABLE_VI, ConditionResult, ModelResult, PairedComparison, compare, summarise
from juicer.reporting.content import (
    AugmentationYield,
    DatasetSize,
    FilmStrip,
    Funnel,
    LineageNode,
    NextStep,
    ReportData,
    StageCost,
    TrainingCurve,
)
from juicer.storage.curves import read_curves
from juicer.storage.tables import read_evaluation
from juicer.tasks.registry import get_task
from stages.names import STAGES

_CURVES = {"train/loss": "training", "validation/loss": "validation"}


class ReportRow(StrictConfig):
    """Whose evaluation the one at the same place is."""

    condition: str
    seed: int


def condition_results(
    store: ArtifactStore, evaluations: Sequence[ArtifactRef], rows: Sequence[ReportRow]
) -> list[ConditionResult]:
    """Rows of the comparison, in the order in which the conditions first occur."""
    models: dict[str, list[ModelResult]] = {}
    for ref, row in zip(evaluations, rows, strict=True):
        table = read_evaluation(store.open(ref, "evaluation"))
        result = ModelResult(
            seed=row.seed,
            initial_states=tuple(entry.seed for entry in table),
            successes=tuple(entry.outcome is Outcome.SUCCESS for entry in table),
        )
        models.setdefault(row.condition, []).append(result)
    return [summarise(condition, results) for condition, results in models.items()]


def gather(
    store: ArtifactStore,
    evaluations: Sequence[ArtifactRef],
    rows: Sequence[ReportRow],
    *,
    title: str,
    task: str,
    facts: Mapping[str, str],
    findings: tuple[str, ...],
    films: tuple[FilmStrip, ...],
) -> ReportData:
    """Everything the page shows."""
    results = condition_results(store, evaluations, rows)
    sources = _Sources(store, evaluations, rows)
    return ReportData(
        title=title,
        created=datetime.now(),
        facts={**facts, **sources.facts()},
        findings=findings,
        results=tuple(results),
        paper=PAPER_TABLE_VI.get(task, {}),
        comparisons=tuple(_comparisons(results)),
        funnels=tuple(sources.funnels()),
        curves=tuple(sources.curves()),
        augmentations=tuple(sources.augmentations()),
        datasets=tuple(sources.datasets()),
        films=films,
        lineage=tuple(lineage_nodes(store, evaluations)),
        costs=tuple(sources.costs()),
        next_steps=tuple(_next_steps(evaluations)),
    )


class _Sources:
    """The manifests behind the evaluations, read once."""

    def __init__(self, store: ArtifactStore, evaluations: Sequence[ArtifactRef], rows: Sequence[ReportRow]) -> None:
        self._store = store
        self._rows = rows
        self._evaluations = [store.manifest(ref) for ref in evaluations]
        refs = dict.fromkeys(each for ref in evaluations for each in (*store.lineage(ref), ref))
        self._manifests = list(_manifests(store, refs))

    def facts(self) -> dict[str, str]:
        """Size of the demonstrations, and the machine that computed the last evaluation."""
        host = self._evaluations[-1].host
        facts = {"Machine": f"{host['cpus']} CPUs, {host['platform']}", "juicer": str(host["juicer"])}
        sizes = {
            self._task_of(manifest): f"{manifest.summary['episodes']} ({manifest.summary['steps']} steps)"
            for manifest in self._of_stage("ingest")
        }
        if len(sizes) > 1:
            sizes = {task: f"{task} {size}" for task, size in sizes.items()}
        return facts | ({"Demonstrations": ", ".join(sizes.values())} if sizes else {})

    def funnels(self) -> Iterator[Funnel]:
        """Milestones of every condition in the task's order, all its models together."""
        for condition, manifests in self._by_condition():
            milestones = get_task(manifests[0].recipe.config["task"]).milestones
            reached = {name: sum(manifest.summary["milestones"][name] for manifest in manifests) for name in milestones}
            yield Funnel(condition, sum(manifest.summary["episodes"] for manifest in manifests), reached)

    def curves(self) -> Iterator[TrainingCurve]:
        """One for every checkpoint."""
        for manifest in self._of_stage("train"):
            curves = read_curves(self._store.open(manifest.ref))
            steps = np.unique([step for name in _CURVES for step in curves.get(name, ((), ()))[0]]).astype(np.int64)
            losses = {}
            for name, label in _CURVES.items():
                if name in curves:
                    values = np.full(len(steps), np.nan)
                    values[np.searchsorted(steps, curves[name][0])] = curves[name][1]
                    losses[label] = values
            yield TrainingCurve(self._name_of(manifest), steps, losses)

    def augmentations(self) -> Iterator[AugmentationYield]:
        """One for every set of corrective episodes."""
        for manifest in self._of_stage("augment"):
            summary = manifest.summary
            yield AugmentationYield(
                label=f"{summary['snippets']} corrective episodes of {self._task_of(manifest)}",
                kept=summary["snippets"],
                rejected=summary["rejections"],
                by_critical_state={
                    name: (counts["snippets"], counts["attempts"])
                    for name, counts in summary["by_critical_state"].items()
                },
            )

    def datasets(self) -> Iterator[DatasetSize]:
        """What the evaluated model of every condition was trained on."""
        for condition, manifests in self._by_condition():
            summaries = [self._store.manifest(_checkpoint_of(manifest)).summary for manifest in manifests]
            # A policy that only replays cuts no windows.
            episodes, timesteps, unused = (
                _average([summary.get(name, {}) for summary in summaries])
                for name in ("episodes", "timesteps", "unused_timesteps")
            )
            yield DatasetSize(condition, episodes, timesteps, unused)

    def costs(self) -> Iterator[StageCost]:
        """What each stage cost, whenever it was computed."""
        for name in STAGES:
            manifests = self._of_stage(name)
            if manifests:
                yield StageCost(
                    stage=name,
                    artifacts=len(manifests),
                    seconds=sum(manifest.seconds for manifest in manifests),
                    megabytes=sum(entry.bytes for manifest in manifests for entry in manifest.files) / 1e6,
                )

    def _by_condition(self) -> Iterator[tuple[str, list[Manifest]]]:
        for condition in dict.fromkeys(row.condition for row in self._rows):
            pairs = zip(self._rows, self._evaluations, strict=True)
            yield condition, [manifest for row, manifest in pairs if row.condition == condition]

    def _of_stage(self, name: str) -> list[Manifest]:
        return [manifest for manifest in self._manifests if manifest.recipe.stage == name]

    def _task_of(self, data: Manifest) -> str:
        """The task of demonstrations, or of what was grown from them."""
        if data.recipe.stage == "ingest":
            return str(data.recipe.config["task"])
        try:
            return self._task_of(self._store.manifest(data.recipe.inputs["episodes"][0]))
        except ArtifactError:
            return "demonstrations that are no longer there"

    def _name_of(self, checkpoint: Manifest) -> str:
        """The models that act with a checkpoint, or those that grew out of it."""
        for row, evaluation in zip(self._rows, self._evaluations, strict=True):
            if _checkpoint_of(evaluation) == checkpoint.ref:
                return f"{row.condition}, seed {row.seed}"
        for row, evaluation in zip(self._rows, self._evaluations, strict=True):
            if checkpoint.ref in self._store.lineage(evaluation.ref):
                return f"{row.condition}, seed {row.seed}, before retraining, {', '.join(checkpoint.summary['tasks'])}"
        return checkpoint.ref.id


def lineage_nodes(store: ArtifactStore, refs: Sequence[ArtifactRef]) -> Iterator[LineageNode]:
    """Artifacts and everything they were made from, each once."""
    for each in dict.fromkeys(each for ref in refs for each in (*store.lineage(ref), ref)):
        try:
            manifest = store.manifest(each)
        except ArtifactError:
            yield LineageNode(str(each), each.kind, "no longer there")
            continue
        yield LineageNode(str(each), each.kind, label_of(manifest), tuple(map(str, manifest.recipe.parents)))


def label_of(manifest: Manifest) -> str:
    """What an artifact is, in a few words."""
    summary: Mapping[str, Any] = manifest.summary
    if manifest.recipe.kind == "evaluation":
        return f"{summary['success_rate']:.0%} of {summary['episodes']} episodes"
    nouns = {
        "record": ("logs", "logs"),
        "ingest": ("episodes", "demonstrations"),
        "annotate": ("critical_states", "critical states"),
        "augment": ("snippets", "snippets"),
        "collect": ("episodes", "rollouts"),
        "select": ("kept", "kept"),
        "train": ("steps", "steps"),
    }
    key, noun = nouns.get(manifest.recipe.stage, ("", ""))
    return f"{summary[key]} {noun}" if key in summary else manifest.recipe.stage


def _manifests(store: ArtifactStore, refs: Mapping[ArtifactRef, None]) -> Iterator[Manifest]:
    for ref in refs:
        try:
            yield store.manifest(ref)
        except ArtifactError:
            continue


def _checkpoint_of(evaluation: Manifest) -> ArtifactRef:
    return evaluation.recipe.inputs["checkpoint"][0]


def _average(counts: Sequence[Mapping[str, int]]) -> dict[str, float]:
    names = dict.fromkeys(name for entry in counts for name in entry)
    return {name: fmean(entry.get(name, 0) for entry in counts) for name in names}


def _comparisons(results: Sequence[ConditionResult]) -> Iterator[PairedComparison]:
    """Each condition against the first."""
    for result in results[1:]:
        try:
            yield compare(results[0], result)
        except ConfigError:
            continue  # other seeds or other initial states: there is nothing to pair


def _next_steps(evaluations: Sequence[ArtifactRef]) -> Iterator[NextStep]:
    ref = evaluations[-1]
    yield NextStep("see a film of an episode", f"juicer replay {ref.id} --episode 0 --video episode.mp4")
    yield NextStep("see where it came from", f"juicer lineage {ref.id}")
    yield NextStep("open Prefect's and MLflow's pages", "juicer ui")
