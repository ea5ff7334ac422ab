"""``juicer report``: what is known of a study so far, as one page over all of its tasks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import date
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
    from juicer.artifacts.store import ArtifactStore
    from juicer.study.material import TaskStudy


def write_report_page(choice: Choice, output: Path, as_json: bool) -> None:
    """``juicer report``; computes nothing but the page."""
    check_place(output, "Markdown page", (".md",))
    store = open_store(read_settings())
    runs = choice.runs()
    from juicer.study.markdown import write_markdown
    from juicer.study.sections import sections

    counted = [_known(store, run) for run in runs]
    studies = [study for study, _, _ in counted if study]
    evaluated, planned = sum(known for _, known, _ in counted), sum(planned for _, _, planned in counted)
    if not studies:
        raise NothingLeft(f"no model of {printable(choice.source)} is evaluated yet; `juicer run` does that")
    facts = _facts(choice, runs, studies) | {"models evaluated": f"{evaluated} of {planned}"}
    shown = printable(output, 500)
    try:
        files = write_markdown(output, Path(choice.source).stem.replace("_", " "), facts, sections(studies))
    except OSError as error:
        raise ConfigError(f"'{shown}' cannot be written: {error.strerror or error}; give another file") from None
    if as_json:
        say_json({"files": [str(path) for path in files], "evaluated": evaluated, "models": planned})
    else:
        say(f"{shown}: {evaluated} of {planned} models, {len(files) - 1} drawings beside it")


def _known(store: ArtifactStore, run: RunConfig) -> tuple[TaskStudy | None, int, int]:
    """What is known of a run; how many of its models are evaluated, and how many it has."""
    from flows.running.execution import analyses_of, rows_of
    from flows.running.plan import evaluated_models
    from juicer.reporting.analyses import shown_analyses
    from juicer.study.material import task_study

    models, planned = evaluated_models(store, run)
    if not models:
        return None, 0, planned
    study = task_study(store, run.task, *rows_of(models), run.drawn_curves)
    refs, rows = analyses_of(models)
    analyses = tuple(zip(rows, shown_analyses(store, refs, rows), strict=True))
    return replace(study, analyses=analyses), len(models), planned


def _facts(choice: Choice, runs: Sequence[RunConfig], studies: Sequence[TaskStudy]) -> dict[str, str]:
    """What the page was made of, and how it is made again."""
    facts = {
        "made on": date.today().isoformat(),
        "made again by": f"juicer run {choice.source}; juicer report {choice.source}",
        "changed by": ", ".join(choice.overrides),
        "tasks": ", ".join(study.task for study in studies),
        "randomness, unless said otherwise": ", ".join(dict.fromkeys(run.randomness.value for run in runs)),
        **_joined([study.sources.origins() for study in studies]),
    }
    return {name: told for name, told in facts.items() if told}


def _joined(tables: Sequence[Mapping[str, str]]) -> Mapping[str, str]:
    """Facts of several tasks, each said once."""

    def all_of(name: str) -> Iterator[str]:
        yield from dict.fromkeys(table[name] for table in tables if name in table)

    return {name: "; ".join(all_of(name)) for name in dict.fromkeys(name for table in tables for name in table)}
