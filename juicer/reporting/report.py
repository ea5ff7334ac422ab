"""What a report says, read from the evaluations and from everything they were made from."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from typing import Any

import yaml

from juicer.artifacts.commit import CHANGED, UNKNOWN
from juicer.artifacts.ref import ArtifactRef
from juicer.evaluation import ConditionResult
from juicer.reporting.content import EpisodeVideo, NextStep, Provenance, ReportData, ShownAnalysis
from juicer.reporting.paper import paper_figures
from juicer.reporting.section import Section
from juicer.reporting.sources import Sources, origins_of


def gather(
    sources: Sources,
    results: Sequence[ConditionResult],
    *,
    title: str,
    task: str,
    facts: Mapping[str, str],
    findings: tuple[str, ...],
    sections: tuple[Section, ...] = (),
    videos: tuple[EpisodeVideo, ...] = (),
    varied: tuple[bytes, ...] = (),
    analyses: tuple[ShownAnalysis, ...] = (),
    configuration: Mapping[str, Any] | None = None,
    links: Mapping[str, str] | None = None,
) -> ReportData:
    """Everything the page shows; what is told beside the rates is told of the evaluations without a shift."""
    sources = sources.unshifted()
    curves = tuple(sources.curves())
    return ReportData(
        title=title,
        created=datetime.now(),
        facts={**facts, **sources.facts()},
        findings=(*findings, *sources.problems),
        results=tuple(results),
        paper={name: figures for name, figures in paper_figures(task).items() if name in sources.plain},
        sections=sections,
        funnels=tuple(sources.funnels()),
        curves=curves,
        augmentations=tuple(sources.augmentations()),
        estimators=tuple(sources.estimators()),
        varied=varied,
        analyses=analyses,
        videos=videos,
        models=tuple(sources.models()),
        lineage=tuple(sources.lineage(sources.refs)),
        provenance=_provenance(sources, title, configuration or {}, links or {}),
        next_steps=tuple(_next_steps(sources.refs, title)),
    )


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
        facts=origins_of([sources]),
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


def _next_steps(evaluations: Sequence[ArtifactRef], experiment: str) -> Iterator[NextStep]:
    ref = evaluations[-1]
    yield NextStep("watch any evaluated episode", f"juicer replay {ref.id} --episode 0")
    yield NextStep("see where the last evaluation came from", f"juicer lineage {ref.id}")
    yield NextStep(f"open Prefect's and MLflow's pages; the experiment is called {experiment}", "juicer ui")
