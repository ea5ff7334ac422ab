"""Section on what policies learned from, in the form of the paper's Table V."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from statistics import fmean

from juicer.episode import Source
from juicer.provenance import NOUNS
from juicer.reporting.lineage import checkpoint_of
from juicer.reporting.paper import PAPER_TABLE_V
from juicer.reporting.section import Section, Table
from juicer.study.material import Measured, TaskStudy


def learned_section(studies: Sequence[TaskStudy]) -> Section | None:
    """What each condition learned from."""
    tables = tuple(table for study in studies for table in _learned(study))
    if not tables:
        return None
    sources = " / ".join(f"{noun}s" for noun in NOUNS.values())
    return Section(
        "learned",
        "Learned from",
        "What each policy learned from",
        f"As in the paper's Table V: {sources}, means over the models of a condition. Windows are the samples that "
        "training cut out of them, but for episodes that it held out for validation. Unused are steps at which none "
        "begins: the ends of episodes, and episodes shorter than a window. A dataset's weights, e.g. "
        "synthetic_share, say how often each is seen; these numbers are without them.",
        tables,
    )


def _learned(study: TaskStudy) -> Iterator[Table]:
    rows = []
    for name, each in study.measured.items():
        if summaries := _learners(study, each):
            facts = ("episodes", "timesteps", "windows", "unused_timesteps")
            episodes, steps, windows, unused = (_mean(summaries, fact) for fact in facts)
            total = sum(steps.values())
            share = f"{steps[Source.AUGMENTATION] / total:.0%}" if total else "-"
            paper = "-" if each.setting else _of_paper(study.task, name)
            counts = map(_by_source, (episodes, steps, windows))
            rows.append((study.title_with_tasks(each), *counts, f"{sum(unused.values()):.0f}", share, paper))
    columns = (
        "condition",
        "episodes",
        "steps",
        "windows",
        "unused steps",
        "snippets' share of these steps",
        "paper: episodes",
    )
    if rows:
        yield Table(columns, tuple(rows), study.task)


def _of_paper(task: str, condition: str) -> str:
    counts = PAPER_TABLE_V.get(task, {}).get(condition)
    return " / ".join(map(str, counts)) if counts else "-"


def _learners(study: TaskStudy, measured: Measured) -> list[Mapping[str, Mapping[str, int]]]:
    """Summaries of the checkpoints that were evaluated; one that only replays demonstrations has cut no windows."""
    checkpoints = {ref for each in measured.evaluations if (ref := checkpoint_of(each))}
    behind = study.sources.behind([manifest.ref for manifest in measured.evaluations])
    return [each.summary for each in behind if each.ref in checkpoints]


def _mean(summaries: Sequence[Mapping[str, Mapping[str, int]]], fact: str) -> dict[Source, float]:
    return {source: fmean(summary.get(fact, {}).get(source, 0) for summary in summaries) for source in NOUNS}


def _by_source(counts: Mapping[Source, float]) -> str:
    return " / ".join(f"{counts[source]:.0f}" for source in NOUNS)
