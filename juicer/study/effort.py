"""Section on the time of a human: for demonstrations in the form of the paper's Table IV, and for each condition."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from statistics import fmean
from typing import Any

from juicer.annotation.measures import PEOPLE
from juicer.artifacts.manifest import Manifest
from juicer.demonstration.recording import minutes_of
from juicer.reporting.paper import PAPER_TABLE_IV
from juicer.reporting.section import Section, Table
from juicer.study.material import Measured, TaskStudy, temperament_of

LABEL_S = 12.0
"""Human seconds a critical state takes to be labelled on a task that the paper does not have: as on its one_leg."""

MINUTES_OF: Mapping[str, str] = {"ingest": "demonstrations", "annotate": "labels", "correct": "corrections"}
"""What a human spends time on, by the stage that brings it in."""


def effort_section(studies: Sequence[TaskStudy]) -> Section | None:
    """What demonstrating and annotating took, and points of success a minute."""
    demonstrations = tuple(row for study in studies for row in _demonstrated(study))
    if not demonstrations:
        return None
    columns = (
        "task", "randomness", "demonstrations", "of recordings", "recorded by", "steps each", "minutes",
        "critical states each", "marked by", "paper: steps each", "paper: recording, min", "paper: annotating, min",
    )  # fmt: skip
    return Section(
        "effort",
        "Effort",
        "What it takes of a human",
        "Minutes are those of whoever holds the device: ten control steps a second of every recording and correction, "
        "also of those that failed. Of a person's recordings that is the least they can have taken: what was undone or "
        "discarded left none, and slow motion counts as real time. What annotating took is measured on juicer's page, "
        "and of labels from elsewhere it is what the paper's annotators needed for as many critical states of that "
        "task; what is proposed beside labels counts nothing. A labels file does not tell which of its labels were "
        "proposed and only looked at, so all of them count. Where the operator is scripted, and where all critical "
        "states are proposed, no person spent the minutes that are told: they are those that people would need. "
        "Corrections of a round in which none succeeded are not counted.",
        (
            Table(columns, demonstrations, "Demonstrations, as in the paper's Table IV, which is of 50"),
            *_annotated(studies),
            *(_by_condition(study) for study in studies if study.measured),
        ),
    )


def _demonstrated(study: TaskStudy) -> Iterator[tuple[str, ...]]:
    """One line for each set of demonstrations of the task that the study's conditions begin with."""
    behind = study.behind
    annotations = {each.recipe.inputs["episodes"][0]: each for each in behind if each.recipe.stage == "annotate"}
    recordings = {each.ref: each for each in behind if each.recipe.stage == "record"}
    paper = PAPER_TABLE_IV.get(study.task)
    for each in behind:
        if each.recipe.stage != "ingest" or each.recipe.config["task"] != study.task:
            continue
        episodes, steps = each.summary["episodes"], each.summary["steps"]
        of_store = each.recipe.inputs.get("logs", ())
        logs = recordings.get(of_store[0]) if of_store else None
        marked = annotations.get(each.ref)
        yield (
            study.task,
            logs.recipe.config["randomness"] if logs else "-",
            str(episodes),
            *_recorded(each, logs, is_by_people=not of_store),
            f"{steps / episodes:.0f}" if episodes else "-",
            f"{_minutes(each, study):.1f}",
            f"{marked.summary['critical_states'] / episodes:.1f}" if marked and episodes else "-",
            ", ".join(marked.summary["authors"]) if marked else "-",
            *((str(paper.steps), str(paper.collecting_min), str(paper.annotating_min)) if paper else ("-",) * 3),
        )


def _recorded(demonstrations: Manifest, logs: Manifest | None, *, is_by_people: bool) -> tuple[str, str]:
    """Of how many recordings demonstrations are, and who made these; logs of the store may have been removed."""
    if logs:
        return str(logs.summary["logs"]), f"{logs.summary['device']}{temperament_of(logs)}"
    return (str(len(demonstrations.recipe.files)), "people") if is_by_people else ("-", "-")


def _annotated(studies: Sequence[TaskStudy]) -> Iterator[Table]:
    """What people did on the page, if anybody annotated there."""
    columns = (
        "task", "demonstrations judged", "annotators", "minutes", "minutes for 50", "seconds each", "keys each",
        "agree with the proposal", "steps between annotators", "disputed", "paper: annotating 50, min",
    )  # fmt: skip
    rows = tuple(
        _measured(study.task, each.summary[PEOPLE])
        for study in studies
        for each in study.behind
        if each.summary.get(PEOPLE, {}).get("minutes") and study.sources.task_of(each) == study.task
    )
    if rows:
        yield Table(columns, rows, "Annotation, as the page measured it")


def _measured(task: str, people: Mapping[str, Any]) -> tuple[str, ...]:
    """Of what nothing is known, such as the distance between annotators where there is one, nothing is said."""
    paper = PAPER_TABLE_IV.get(task)

    def shown(name: str, form: str, factor: float = 1) -> str:
        return format(people[name] * factor, form) if name in people else "-"

    return (
        task,
        shown("judged", "d"),
        shown("annotators", "d"),
        shown("minutes", ".1f"),
        shown("seconds", ".1f", 50 / 60),
        shown("seconds", ".1f"),
        shown("keys", ".2f"),
        shown("agreement", ".0%"),
        shown("steps_between_annotators", ".1f"),
        shown("disputed", "d"),
        str(paper.annotating_min) if paper else "-",
    )


def _by_condition(study: TaskStudy) -> Table:
    columns = ("condition", *(f"{name}, min" for name in MINUTES_OF.values()), "together, min", "points a minute")
    rows = tuple(_row(study, each) for each in study.measured.values())
    return Table(columns, rows, f"{study.task}: minutes behind a model, and points of success a minute")


def _row(study: TaskStudy, measured: Measured) -> tuple[str, ...]:
    models = [_spent(study, made_of) for made_of in study.behind_models(measured)]
    minutes = [fmean(each[name] for each in models) for name in MINUTES_OF]
    together = sum(minutes)
    # What several tasks took is not to be set against the success at one of them.
    is_for_one = len(study.tasks_behind(measured)) <= 1
    a_minute = f"{100 * measured.result.average / together:.1f}" if together and is_for_one else "-"
    return study.title_with_tasks(measured), *(f"{each:.1f}" for each in (*minutes, together)), a_minute


def _spent(study: TaskStudy, made_of: Iterable[Manifest]) -> dict[str, float]:
    """Minutes by stage, of all tasks that a model was taught."""
    spent = dict.fromkeys(MINUTES_OF, 0.0)
    for manifest in made_of:
        if manifest.recipe.stage in spent:
            spent[manifest.recipe.stage] += _minutes(manifest, study)
    return spent


def _minutes(manifest: Manifest, study: TaskStudy) -> float:
    """Minutes of a human in what an artifact brings in."""
    summary = manifest.summary
    if manifest.recipe.stage == "annotate":
        paper = PAPER_TABLE_IV.get(study.sources.task_of(manifest))
        each_s = 60 * paper.annotating_min / (50 * paper.critical_states) if paper else LABEL_S
        if PEOPLE in summary:
            people = summary[PEOPLE]
            # Annotations of an earlier juicer do not tell what was marked elsewhere than on the page.
            return float(people["minutes"]) + each_s * int(people.get("elsewhere", 0)) / 60
        # Beside labels of a file, proposals took nobody's time; without a file they stand for what people would mark.
        marked = summary["authors"].get("human", 0) if manifest.recipe.files else summary["critical_states"]
        return each_s * int(marked) / 60
    if manifest.recipe.stage == "correct":
        return minutes_of(summary["human_steps"])
    # Demonstrations of an earlier juicer do not tell how long rejected recordings were.
    kept = minutes_of(summary["steps"] + summary["idle_steps_dropped"])
    return float(summary.get("operator_minutes", kept))
