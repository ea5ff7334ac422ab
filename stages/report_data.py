"""What a report says, read from the evaluations and from everything they were made from."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from typing import Any

import yaml

from juicer.artifacts.commit import CHANGED, UNKNOWN
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.episode import Outcome
from juicer.errors import ArtifactError, ConfigError
from juicer.evaluation import PAPER_TABLE_VI, ConditionResult, ModelResult, PairedComparison, compare, summarise
from juicer.reporting.content import EpisodeVideo, LineageNode, NextStep, Provenance, ReportData
from juicer.storage.tables import read_evaluation
from stages.report_sources import ReportRow, Sources, label_of, nodes_of, read_lineage

__all__ = ["ReportRow", "condition_results", "gather", "label_of", "lineage_nodes"]


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
    videos: tuple[EpisodeVideo, ...] = (),
    configuration: Mapping[str, Any] | None = None,
    links: Mapping[str, str] | None = None,
) -> ReportData:
    """Everything the page shows."""
    results = condition_results(store, evaluations, rows)
    sources = Sources(store, evaluations, rows)
    curves = tuple(sources.curves())
    return ReportData(
        title=title,
        created=datetime.now(),
        facts={**facts, **sources.facts()},
        findings=(*findings, *sources.problems),
        results=tuple(results),
        paper=PAPER_TABLE_VI.get(task, {}),
        comparisons=tuple(_comparisons(results)),
        funnels=tuple(sources.funnels()),
        curves=curves,
        augmentations=tuple(sources.augmentations()),
        datasets=tuple(sources.datasets()),
        videos=videos,
        models=tuple(sources.models()),
        lineage=tuple(sources.lineage(evaluations)),
        provenance=_provenance(sources, title, configuration or {}, links or {}),
        costs=tuple(sources.costs()),
        next_steps=tuple(_next_steps(evaluations, title)),
    )


def lineage_nodes(store: ArtifactStore, refs: Sequence[ArtifactRef]) -> Iterator[LineageNode]:
    """Artifacts and everything they were made from, each once."""
    return nodes_of(read_lineage(store, refs))


def configuration_text(configuration: Mapping[str, Any]) -> str:
    """A configuration as YAML; nothing if there is none."""
    if not configuration:
        return ""
    # Lists of numbers on one line each.
    return yaml.safe_dump(dict(configuration), sort_keys=False, allow_unicode=True, default_flow_style=None, width=100)


def _provenance(sources: Sources, title: str, configuration: Mapping[str, Any], links: Mapping[str, str]) -> Provenance:
    file_name = f"{re.sub(r'[^A-Za-z0-9_.-]+', '-', title).strip('-.') or 'configuration'}.yaml"
    commits = sources.commits
    commands = [f"juicer run {file_name}"] if configuration else []
    if (commit := commits[0].removesuffix(CHANGED)) != UNKNOWN:
        commands.insert(0, f"git checkout {commit}")
    return Provenance(
        facts=sources.origins(),
        configuration=configuration_text(configuration),
        file_name=file_name,
        commands=tuple(commands),
        caveat=_caveat(commits),
        links=links,
    )


def _caveat(commits: Sequence[str]) -> str:
    if any(commit.endswith(CHANGED) for commit in commits):
        return "Some of it was made with code that no commit holds, so it may not come out the same."
    if UNKNOWN in commits:
        return "Some of it was made by a juicer whose commit is unknown, e.g. one that was installed as a package."
    return "It was made with several commits, so it may not come out the same." if len(commits) > 1 else ""


def _comparisons(results: Sequence[ConditionResult]) -> Iterator[PairedComparison]:
    """Each condition against the first."""
    for result in results[1:]:
        try:
            yield compare(results[0], result)
        except ConfigError:
            continue  # other seeds or other initial states: there is nothing to pair


def _next_steps(evaluations: Sequence[ArtifactRef], experiment: str) -> Iterator[NextStep]:
    ref = evaluations[-1]
    yield NextStep("watch any evaluated episode", f"juicer replay {ref.id} --episode 0")
    yield NextStep("see where the last evaluation came from", f"juicer lineage {ref.id}")
    yield NextStep(f"open Prefect's and MLflow's pages; the experiment is called {experiment}", "juicer ui")
