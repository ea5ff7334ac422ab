"""Results of conditions that never ran."""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

import pytest

from juicer.evaluation import ConditionResult, ModelResult, summarise
from juicer.reporting.sources import Sources
from juicer.seeding import stream
from juicer.study.curves import Curve
from juicer.study.material import Measured, TaskStudy

Results = Callable[..., ConditionResult]


def make_result(name: str, *rates: float, episodes: int = 100) -> ConditionResult:
    """Models with exactly these rates, whose episodes start from the same states in an order of each one's own."""
    models = []
    for seed, rate in enumerate(rates):
        succeeded = stream(seed, name).permutation(episodes) < round(rate * episodes)
        models.append(ModelResult(seed, tuple(range(episodes)), tuple(map(bool, succeeded))))
    return summarise(name, models, name.upper())


def make_study(*results: ConditionResult, curves: tuple[Curve, ...] = (), settings: dict[str, str] | None = None):
    """A study of one_leg; conditions with a setting start from states of their own."""
    settings = settings or {}
    measured = {
        each.condition: Measured(each, settings.get(each.condition, ""), settings.get(each.condition, ""), ())
        for each in results
    }
    # What these sections tell is read off results alone.
    return TaskStudy("one_leg", measured, cast(Sources, None), curves)


@pytest.fixture
def result() -> Results:
    """E.g. ``result("bc", 0.5, 0.6)``: two models of a condition."""
    return make_result


@pytest.fixture
def study() -> Callable[..., TaskStudy]:
    """A study made of results."""
    return make_study
