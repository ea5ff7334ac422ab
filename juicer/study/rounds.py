"""Section on what models cost a human, and on how good their predecessors of every round were."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import zip_longest
from statistics import fmean
from typing import TypeVar

from juicer.artifacts.manifest import Manifest
from juicer.evaluation import hierarchical_interval
from juicer.reporting.section import Section, Table
from juicer.seeding import stream
from juicer.sim.env import STEP_S
from juicer.study.material import Measured, TaskStudy
from juicer.study.success import interval_text, percent

_Item = TypeVar("_Item")

LABEL_S = 12.0
"""Human seconds a critical state takes to be labelled: the paper's ten minutes for the fifty of one_leg."""

MINUTES_OF: Mapping[str, str] = {"ingest": "demonstrations", "annotate": "labels", "correct": "corrections"}
"""What a human spends time on, by the stage that brings it in."""


def rounds_section(studies: Sequence[TaskStudy]) -> Section | None:
    """Rate of every round, human minutes, and points of success a minute."""
    tables = tuple(_table(study) for study in studies if study.measured)
    if not tables:
        return None
    return Section(
        "rounds",
        "Rounds",
        "What each round brought, and what it cost a human",
        f"Minutes of one model: recorded time of demonstrations and corrections, and {LABEL_S:.0f} s a critical state "
        "for labels, as the paper's annotators needed. A round's rate is that of the model that collects in it, in its "
        "own rollouts, whose initial states are new to it.",
        tables,
    )


def _table(study: TaskStudy) -> Table:
    rounds = {name: _rounds_of(study, each) for name, each in study.measured.items()}
    number = max(map(len, rounds.values()))
    columns = (
        "condition",
        *(f"round {turn + 1}" for turn in range(number)),
        "evaluated",
        *(f"{name}, min" for name in MINUTES_OF.values()),
        "together, min",
        "points a minute",
    )
    rows = tuple(_row(study, each, [*rounds[name], *[""] * (number - len(rounds[name]))])
                 for name, each in study.measured.items())  # fmt: skip
    return Table(columns, rows, study.task)


def _row(study: TaskStudy, measured: Measured, rounds: Sequence[str]) -> tuple[str, ...]:
    models = [_minutes(made_of) for made_of in _made_of(study, measured)]
    minutes = {name: fmean(each[name] for each in models) for name in MINUTES_OF.values()}
    together, rate = sum(minutes.values()), measured.result.average
    return (
        measured.result.title,
        *(told or "-" for told in rounds),
        percent(rate),
        *(f"{each:.1f}" for each in minutes.values()),
        f"{together:.1f}",
        f"{100 * rate / together:.1f}" if together else "-",
    )


def _made_of(study: TaskStudy, measured: Measured) -> list[Sequence[Manifest]]:
    """All that each model's evaluation was made of, as far as it is known."""
    usual = [each for each in measured.evaluations if not each.recipe.config.get("shift")]
    return [study.sources.behind([each.ref]) for each in usual]


def _minutes(made_of: Iterable[Manifest]) -> dict[str, float]:
    spent = dict.fromkeys(MINUTES_OF.values(), 0.0)
    for manifest in made_of:
        if name := MINUTES_OF.get(manifest.recipe.stage):
            spent[name] += _seconds(manifest) / 60
    return spent


def _seconds(manifest: Manifest) -> float:
    summary = manifest.summary
    if manifest.recipe.stage == "ingest":
        return STEP_S * (int(summary["steps"]) + int(summary["idle_steps_dropped"]))
    if manifest.recipe.stage == "annotate":
        return LABEL_S * int(summary["critical_states"])
    return STEP_S * int(summary["human_steps"])


def _rounds_of(study: TaskStudy, measured: Measured) -> list[str]:
    """Average rate of each turn of collect, select, train, with its interval."""
    models = [list(_turns(made_of)) for made_of in _made_of(study, measured)]
    return [_rate(turn) for turn in _transposed(models)]


def _turns(made_of: Iterable[Manifest]) -> Iterator[tuple[int, int]]:
    """Successes and episodes of each turn, of all tasks together."""
    by_task: defaultdict[str, list[Manifest]] = defaultdict(list)
    for manifest in made_of:
        if manifest.recipe.stage == "collect":
            by_task[manifest.recipe.config["task"]].append(manifest)
    # Every turn starts from later initial states than the one before.
    turns = [sorted(each, key=lambda manifest: manifest.recipe.config["first"]) for each in by_task.values()]
    for turn in _transposed(turns):
        yield sum(each.summary["successes"] for each in turn), sum(each.summary["episodes"] for each in turn)


def _rate(turn: Sequence[tuple[int, int]]) -> str:
    successes, episodes = zip(*turn, strict=True)
    interval = hierarchical_interval(successes, episodes, stream(0, "hierarchical interval"))
    return f"{percent(fmean(won / tried for won, tried in turn))} ({interval_text(interval)})"


def _transposed(rows: Sequence[Sequence[_Item]]) -> Iterator[list[_Item]]:
    """First items of all rows, then second ones, and so on; rows may differ in length."""
    for items in zip_longest(*rows):
        yield [item for item in items if item is not None]
