"""What a model cost a human, and how good its predecessors were, read from what it was made of."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import zip_longest
from statistics import fmean
from typing import TypeVar

from juicer.artifacts.manifest import Manifest
from juicer.evaluation import hierarchical_interval
from juicer.reporting.content import Effort
from juicer.seeding import stream
from juicer.sim.env import STEP_S

_Item = TypeVar("_Item")

LABEL_S = 12.0
"""Human seconds a critical state takes to be labelled: the paper's ten minutes for the fifty of one_leg."""

MINUTES_OF: Mapping[str, str] = {"ingest": "demonstrations", "annotate": "labels", "correct": "corrections"}
"""What a human spends time on, by the stage that brings it in."""


def effort_of(condition: str, models: Sequence[Sequence[Manifest]]) -> Effort:
    """What a condition's models cost on average, and the average rate of each round.

    Args:
        condition: Its title.
        models: All that each model's evaluation was made of and the evaluation itself, as far as it is known.
    """
    minutes = [_minutes(made_of) for made_of in models]
    evaluations = [made_of[-1] for made_of in models]
    rounds = [list(_rounds(made_of)) for made_of in models]
    return Effort(
        condition=condition,
        minutes={name: fmean(each[name] for each in minutes) for name in MINUTES_OF.values()},
        rate=fmean(evaluation.summary["success_rate"] for evaluation in evaluations),
        rounds=tuple(_rate(turn) for turn in _transposed(rounds)),
    )


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


def _rounds(made_of: Iterable[Manifest]) -> Iterator[tuple[int, int]]:
    """Successes and episodes of each turn, of all tasks together."""
    by_task: defaultdict[str, list[Manifest]] = defaultdict(list)
    for manifest in made_of:
        if manifest.recipe.stage == "collect":
            by_task[manifest.recipe.config["task"]].append(manifest)
    # Every turn starts from later initial states than the one before.
    turns = [sorted(each, key=lambda manifest: manifest.recipe.config["first"]) for each in by_task.values()]
    for turn in _transposed(turns):
        yield sum(each.summary["successes"] for each in turn), sum(each.summary["episodes"] for each in turn)


def _rate(turn: Sequence[tuple[int, int]]) -> tuple[float, float, float]:
    successes, episodes = zip(*turn, strict=True)
    average = fmean(won / tried for won, tried in turn)
    return average, *hierarchical_interval(successes, episodes, stream(0, "hierarchical interval"))


def _transposed(rows: Sequence[Sequence[_Item]]) -> Iterator[list[_Item]]:
    """First items of all rows, then second ones, and so on; rows may differ in length."""
    for items in zip_longest(*rows):
        yield [item for item in items if item is not None]
