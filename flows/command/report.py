"""``juicer report``: what is known of a study so far, as one page over all of its tasks."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import date, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from flows.command.choice import Choice
from flows.command.chosen import check_place
from flows.running.data_folder import open_store
from flows.running.settings import read_settings
from flows.terminal.output import say, say_json
from juicer.errors import ConfigError, NothingLeft
from juicer.text import printable

if TYPE_CHECKING:
    from flows.config import RunConfig
    from flows.loop import ModelOutcome
    from juicer.artifacts.store import ArtifactStore
    from juicer.study.material import TaskStudy

HTML = ".html"
"""Ending of a page that is one file, with its drawings in it."""


def write_report_page(choices: Sequence[Choice], output: Path, as_json: bool) -> None:
    """``juicer report``, of one configuration or of several together; computes nothing but the page.

    Raises:
        ConfigError: If the page cannot be written, or two configurations mean different things by one name.
        NothingLeft: If there are no results yet.
    """
    check_place(output, "page", (".md", HTML))
    store = open_store(read_settings())
    runs = [run for choice in choices for run in choice.runs()]
    counted = [_known(store, [run for run in runs if run.task == task]) for task in dict.fromkeys(r.task for r in runs)]
    studies = [study for study, _, _ in counted if study]
    evaluated, planned = sum(known for _, known, _ in counted), sum(planned for _, _, planned in counted)
    if not studies:
        sources = " and ".join(printable(choice.source) for choice in choices)
        raise NothingLeft(f"no model of {sources} is evaluated yet; `juicer run` does that")
    facts = _facts(choices, output, runs, studies) | {"models evaluated": f"{evaluated} of {planned}"}
    shown = printable(output, 500)
    try:
        files = _write(output, Path(choices[0].source).stem.replace("_", " "), facts, studies)
    except OSError as error:
        raise ConfigError(f"'{shown}' cannot be written: {error.strerror or error}; give another file") from None
    if as_json:
        say_json({"files": [str(path) for path in files], "evaluated": evaluated, "models": planned})
    else:
        beside = f", {len(files) - 1} drawings beside it" if len(files) > 1 else ""
        say(f"{shown}: {evaluated} of {planned} models{beside}")


def _write(output: Path, title: str, facts: Mapping[str, str], studies: Sequence[TaskStudy]) -> list[Path]:
    """Write the page as what its name says; every file written, the page first."""
    from juicer.reporting.content import ReportData
    from juicer.reporting.page import write_page
    from juicer.study.markdown import write_markdown
    from juicer.study.sections import sections

    content = sections(studies)
    if output.suffix.lower() != HTML:
        return write_markdown(output, title, facts, content)
    write_page(ReportData(title, datetime.now(), facts, sections=content), output)
    return [output]


def _known(store: ArtifactStore, runs: Sequence[RunConfig]) -> tuple[TaskStudy | None, int, int]:
    """What is known of runs for one task; how many of their models are evaluated, and how many they have."""
    from flows.running.execution import analyses_of, rows_of
    from flows.running.plan import evaluated_models
    from juicer.reporting.analyses import shown_analyses
    from juicer.study.material import task_study

    models: dict[tuple[str, int], ModelOutcome] = {}
    for run in runs:
        for model in evaluated_models(store, run)[0]:
            own = model if _is_alike(run, runs[0]) else _of(run, model)
            known = models.setdefault((own.condition, own.seed), own)
            if known.evaluation != own.evaluation:
                raise ConfigError(
                    f"condition {own.condition} of {run.name} is another one than that of {runs[0].name}; "
                    "write a page for each"
                )
            models[own.condition, own.seed] = replace(
                known, shifted={**own.shifted, **known.shifted}, analyses={**own.analyses, **known.analyses}
            )
    planned = len({key for run in runs for key in run.models})
    # Of two that are called alike, that of the configuration which is named first.
    curves = {curve.name: curve for run in reversed(runs) for curve in run.drawn_curves}
    if not models:
        return None, 0, planned
    outcomes = list(models.values())
    refs, rows = analyses_of(outcomes)
    analyses = tuple(zip(rows, shown_analyses(store, refs, rows), strict=True))
    study = task_study(store, runs[0].task, *rows_of(outcomes), list(curves.values()), analyses=analyses)
    return study, len(outcomes), planned


def _is_alike(run: RunConfig, other: RunConfig) -> bool:
    """Whether conditions that change nothing mean the same in two configurations, but for their networks."""
    from flows.loop_config import DATA_KEYS
    from flows.written import PATH_KEYS

    return all(getattr(run, key) == getattr(other, key) for key in (*DATA_KEYS, *PATH_KEYS))


def _of(run: RunConfig, model: ModelOutcome) -> ModelOutcome:
    """A model of a configuration that differs from the first: that is said of it as what a condition changes is."""
    return replace(model, setting=model.setting.within(f"as in {run.name}"))


def _facts(
    choices: Sequence[Choice], output: Path, runs: Sequence[RunConfig], studies: Sequence[TaskStudy]
) -> dict[str, str]:
    """What the page was made of, and how it is made again."""
    from juicer.reporting.sources import origins_of

    first, *others = choices
    beside = "".join(f" --with {choice.as_arguments()}" for choice in others)
    report = f"juicer report {first.as_arguments()}{beside} --output {shlex.quote(output.name)}"
    facts = {
        "made on": date.today().isoformat(),
        "made again by": "; ".join([*(f"juicer run {choice.as_arguments()}" for choice in choices), report]),
        "tasks": ", ".join(study.task for study in studies),
        "randomness, unless said otherwise": ", ".join(dict.fromkeys(run.randomness.value for run in runs)),
        **origins_of([study.sources for study in studies]),
    }
    return {name: text for name, text in facts.items() if text}
