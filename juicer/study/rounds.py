"""Section on how good the models of every round were."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import zip_longest
from statistics import fmean

from juicer.artifacts.manifest import Manifest
from juicer.evaluation import hierarchical_interval
from juicer.reporting.section import Section, Table
from juicer.seeding import stream
from juicer.study.material import Measured, TaskStudy
from juicer.study.success import interval_text, percent

Tried = list[tuple[int, int]]
"""Successes and episodes of the rollouts of a model's rounds."""


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
        "it. A model of which nothing was learned in a round, for instance as no rollout succeeded, goes no further, "
        "and is missing from there on: the rate is that of the others, whose number is told, and probably higher than "
        "that of all. One policy for several tasks has no rounds of its own: it learns from rollouts of others.",
        tables,
    )


def _table(study: TaskStudy) -> Table:
    rounds = {
        name: cells
        for name, each in study.measured.items()
        if len(study.tasks_behind(each)) <= 1 and (cells := _rounds_of(study, each))
    }
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
    return [_rate([each for each in turn if each], len(models)) for turn in zip_longest(*models)]


def _tried(made_of: Iterable[Manifest]) -> Tried:
    """What a model's rounds brought, in their order: a later one begins with later initial states."""
    collected = [each for each in made_of if each.recipe.stage == "collect"]
    collected.sort(key=lambda each: int(each.recipe.config["first"]))
    return [(each.summary["successes"], each.summary["episodes"]) for each in collected]


def _rate(turn: Tried, num_models: int) -> str:
    """Of the models that are known to have collected in a round."""
    successes, episodes = zip(*turn, strict=True)
    interval = hierarchical_interval(successes, episodes, stream(0, "hierarchical interval"))
    told = f"{percent(fmean(won / tried for won, tried in turn))} ({interval_text(interval)})"
    return told if len(turn) == num_models else f"{told}, {len(turn)} of {num_models} models"
