"""Sections on what was learned from, what it took to show it, and what every number cost."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean

from juicer.artifacts.manifest import Manifest
from juicer.artifacts.ref import ArtifactRef
from juicer.reporting.lineage import checkpoint_of
from juicer.reporting.paper import PAPER_TABLE_IV, PAPER_TABLE_V
from juicer.reporting.section import Section, Table
from juicer.study.material import Measured, TaskStudy

STEPS_A_MINUTE = 600
"""Control steps; there are ten a second."""
SOURCES = ("teleop", "rollout", "augmentation")


def effort_section(studies: Sequence[TaskStudy]) -> Section | None:
    """Time to demonstrate and to annotate, in the form of the paper's Table IV."""
    rows = tuple(row for study in studies for row in _shown(study))
    columns = (
        "task", "demonstrations", "of recordings", "recorded by", "steps each", "minutes of motion",
        "critical states each", "marked by", "paper: steps each", "paper: recording, min", "paper: annotating, min",
    )  # fmt: skip
    if not rows:
        return None
    return Section(
        "effort",
        "Effort",
        "What it took to demonstrate and annotate",
        "As in the paper's Table IV, which is of 50 demonstrations. Minutes of motion are what the recorded steps last "
        "at ten a second. Where the operator is scripted and critical states are proposed, no person spent a minute on "
        "either; what people need for both is not measured here.",
        (Table(columns, rows),),
    )


def data_section(studies: Sequence[TaskStudy]) -> Section | None:
    """What each condition learned from, in the form of the paper's Table V."""
    tables = tuple(table for study in studies for table in _learned(study))
    if not tables:
        return None
    return Section(
        "learned",
        "Learned from",
        "What each policy learned from",
        "As in the paper's Table V: demonstrations / rollouts / corrective snippets, means over the models of a "
        "condition. Windows are the samples that training cut out of them.",
        tables,
    )


def cost_section(studies: Sequence[TaskStudy]) -> Section | None:
    """CPU time behind every number and behind all of them."""
    rows = [row for study in studies for row in _costs(study)]
    everything = _cost(manifest for study in studies for manifest in study.sources.behind(_evaluations(study)))
    if not rows:
        return None
    rows.append(("all of it, each artifact once", "", everything.cpu, everything.wall))
    return Section(
        "price",
        "CPU-hours",
        "What each number cost",
        "CPU time and wall time of everything that a number was made from, whenever it was computed. What several "
        "conditions have in common counts for each of them, and once in the last line. An artifact of an earlier "
        "juicer tells its wall time only, which then counts as its CPU time.",
        (Table(("condition", "models", "CPU-hours", "hours, one after another"), tuple(rows)),),
    )


@dataclass(frozen=True)
class _Cost:
    cpu: str
    wall: str


def _cost(manifests: Iterable[Manifest]) -> _Cost:
    once = {manifest.ref: manifest for manifest in manifests}.values()
    cpu = sum(each.seconds if each.cpu_seconds is None else each.cpu_seconds for each in once)
    return _Cost(_hours(cpu), _hours(sum(each.seconds for each in once)))


def _hours(seconds: float) -> str:
    return f"{seconds / 3600:.3g}" if seconds < 36_000 else f"{seconds / 3600:.0f}"


def _costs(study: TaskStudy) -> Iterator[tuple[str, ...]]:
    for each in study.measured.values():
        cost = _cost(study.sources.behind([manifest.ref for manifest in each.evaluations]))
        yield f"{study.task}: {each.result.title}", str(each.result.num_models), cost.cpu, cost.wall


def _evaluations(study: TaskStudy) -> list[ArtifactRef]:
    return [manifest.ref for each in study.measured.values() for manifest in each.evaluations]


def _shown(study: TaskStudy) -> Iterator[tuple[str, ...]]:
    """One line for each set of demonstrations of the task that the study's conditions begin with."""
    behind = study.sources.behind(_evaluations(study))
    annotations = {each.recipe.inputs["episodes"][0]: each for each in behind if each.recipe.stage == "annotate"}
    recordings = {each.ref: each for each in behind if each.recipe.stage == "record"}
    for each in behind:
        if each.recipe.stage != "ingest" or each.recipe.config["task"] != study.task:
            continue
        episodes, steps = each.summary["episodes"], each.summary["steps"]
        logs = recordings.get(next(iter(each.recipe.inputs.get("logs", ())), each.ref))
        marked = annotations.get(each.ref)
        paper = PAPER_TABLE_IV.get(study.task)
        yield (
            study.task,
            str(episodes),
            str(logs.summary["logs"]) if logs else str(len(each.recipe.files)),
            str(logs.summary["device"]) if logs else "people",
            f"{steps / episodes:.0f}" if episodes else "-",
            f"{steps / STEPS_A_MINUTE:.0f}",
            f"{marked.summary['critical_states'] / episodes:.1f}" if marked and episodes else "-",
            ", ".join(marked.summary["authors"]) if marked else "-",
            *((str(paper.steps), str(paper.collecting_min), str(paper.annotating_min)) if paper else ("-",) * 3),
        )


def _learned(study: TaskStudy) -> Iterator[Table]:
    rows = []
    for name, each in study.measured.items():
        if summaries := _trained(study, each):
            counts = [_mean(summaries, fact) for fact in ("episodes", "timesteps", "windows")]
            total = sum(counts[1].values())
            share = f"{counts[1].get('augmentation', 0) / total:.0%}" if total else "-"
            paper = "-" if each.setting else _of_paper(study.task, name)
            rows.append((each.result.title, *map(_by_source, counts), share, paper))
    columns = ("condition", "episodes", "steps", "windows", "snippets' share of steps", "paper: episodes")
    if rows:
        yield Table(columns, tuple(rows), study.task)


def _of_paper(task: str, condition: str) -> str:
    counts = PAPER_TABLE_V.get(task, {}).get(condition)
    return " / ".join(map(str, counts)) if counts else "-"


def _trained(study: TaskStudy, measured: Measured) -> list[Mapping[str, Mapping[str, int]]]:
    """Summaries of the checkpoints that were trained; what only replays learned from nothing."""
    checkpoints = {ref for each in measured.evaluations if (ref := checkpoint_of(each))}
    behind = study.sources.behind([manifest.ref for manifest in measured.evaluations])
    return [each.summary for each in behind if each.ref in checkpoints and each.recipe.stage == "train"]


def _mean(summaries: Sequence[Mapping[str, Mapping[str, int]]], fact: str) -> dict[str, float]:
    return {source: fmean(summary.get(fact, {}).get(source, 0) for summary in summaries) for source in SOURCES}


def _by_source(counts: Mapping[str, float]) -> str:
    return " / ".join(f"{counts[source]:.0f}" for source in SOURCES)
