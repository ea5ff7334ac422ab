"""Section on how good the models of every round were."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from statistics import fmean

from juicer.artifacts.manifest import Manifest
from juicer.evaluation import hierarchical_interval
from juicer.reporting.section import Section, Table
from juicer.seeding import stream
from juicer.study.material import Measured, TaskStudy
from juicer.study.success import interval_text, percent

Start = tuple[str, int]
"""A task, and the first of the initial states that a round collects from: a later round's come later."""
Tried = dict[Start, tuple[int, int]]
"""Successes and episodes of a model's rollouts."""


def rounds_section(studies: Sequence[TaskStudy]) -> Section | None:
    """Rate of every round, for the conditions that have some."""
    tables = tuple(table for study in studies if (table := _table(study)).rows)
    if not tables:
        return None
    return Section(
        "rounds",
        "Rounds",
        "How good the models of every round were",
        "A round's rate is that of the model that collects in it, in its own rollouts, whose initial states are new to "
        "it. A model from whose rollouts of a round nothing was learned, for instance as none succeeded, is missing "
        "there: the rate is that of the others, whose number is told, and probably higher than that of all.",
        tables,
    )


def _table(study: TaskStudy) -> Table:
    rounds = {name: cells for name, each in study.measured.items() if (cells := _rounds_of(study, each))}
    number = max(map(len, rounds.values()), default=0)
    rows = tuple(
        (
            study.measured[name].result.title,
            *cells,
            *["-"] * (number - len(cells)),
            percent(study.measured[name].result.average),
        )
        for name, cells in rounds.items()
    )
    return Table(("condition", *(f"round {turn + 1}" for turn in range(number)), "evaluated"), rows, study.task)


def _rounds_of(study: TaskStudy, measured: Measured) -> list[str]:
    """Average rate of each round in which some model collected, with its interval."""
    models = [_tried(made_of) for made_of in study.behind_models(measured)]
    starts: defaultdict[str, set[int]] = defaultdict(set)
    for task, first in (start for model in models for start in model):
        starts[task].add(first)
    number = max(map(len, starts.values()), default=0)
    turns = [{(task, sorted(all_of)[turn]) for task, all_of in starts.items() if turn < len(all_of)}
             for turn in range(number)]  # fmt: skip
    return [_rate(turn, models) for turn in turns]


def _tried(made_of: Iterable[Manifest]) -> Tried:
    return {
        (each.recipe.config["task"], each.recipe.config["first"]): (each.summary["successes"], each.summary["episodes"])
        for each in made_of
        if each.recipe.stage == "collect"
    }


def _rate(turn: set[Start], models: Sequence[Tried]) -> str:
    """Of the models that are known to have collected in a round, of all tasks together."""
    found = [[model[start] for start in turn if start in model] for model in models]
    summed = [tuple(map(sum, zip(*each, strict=True))) for each in found if each]
    successes, episodes = zip(*summed, strict=True)
    interval = hierarchical_interval(successes, episodes, stream(0, "hierarchical interval"))
    told = f"{percent(fmean(won / tried for won, tried in summed))} ({interval_text(interval)})"
    return told if len(summed) == len(models) else f"{told}, {len(summed)} of {len(models)} models"
