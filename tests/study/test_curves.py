"""Curves: their numbers come from the configuration, and a fit tells what it does not know."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from juicer.study.curve_section import curve_section
from juicer.study.curves import Curve, fit_saturation
from juicer.study.points import rivals

TRUE_TOP, TRUE_SCALE = 0.8, 60.0
PLACES = (10, 20, 50, 100, 200, 500)


def rate(x: float) -> float:
    return float(TRUE_TOP * -np.expm1(-x / TRUE_SCALE))


@pytest.fixture
def points(result):
    return [result(f"bc_{x}", *[rate(x)] * 3) for x in PLACES]


def test_a_fit_finds_the_curve_that_rates_follow(points):
    fit = fit_saturation(PLACES, points)
    assert fit is not None
    assert fit.top == pytest.approx(TRUE_TOP, abs=0.01)
    assert fit.enough == pytest.approx(TRUE_SCALE * np.log(20), rel=0.05)
    assert fit.top_interval[0] < TRUE_TOP < fit.top_interval[1]
    assert fit.enough_interval[0] < fit.enough < fit.enough_interval[1]
    assert np.all(fit.low <= fit.high)
    assert (fit.x[0], fit.x[-1]) == pytest.approx((10, 500))


def test_fewer_points_than_tell_a_curve_from_another_are_not_fitted(points):
    assert fit_saturation(PLACES[:3], points[:3]) is None


def test_rates_of_zero_are_fitted_as_well(result):
    fit = fit_saturation(PLACES, [result(f"bc_{x}", 0.0) for x in PLACES])
    assert fit is not None
    assert fit.top < 0.05


@pytest.mark.parametrize("rates", [(0.0,) * 6, (1.0,) * 6])
def test_what_always_fails_or_succeeds_in_a_few_episodes_is_not_known_for_certain(result, rates):
    fit = fit_saturation(PLACES, [result(f"bc_{x}", each, episodes=20) for x, each in zip(PLACES, rates, strict=True)])
    assert fit is not None
    assert fit.top_interval[1] - fit.top_interval[0] > 0.005
    assert np.all(fit.high - fit.low > 0.001)


def test_the_best_point_is_told_with_those_that_may_be_as_good(result, study):
    found = [
        (x, result(name, rate, rate))
        for x, name, rate in ((0, "a", 0.3), (10, "b", 0.8), (20, "c", 0.76), (40, "d", 0.4))
    ]
    (x, _), equals = rivals(study(*(each for _, each in found)), found)
    assert x == 10
    assert [other for other, _ in equals] == [20]


def test_a_point_that_cannot_be_paired_with_the_best_is_not_called_worse(result, study):
    found = [(x, result(name, rate, rate)) for x, name, rate in ((0, "a", 0.3), (10, "b", 0.8), (20, "c", 0.3))]
    tried = study(*(each for _, each in found), settings={"c": "randomness med"})
    _, equals = rivals(tried, found)
    assert [other for other, _ in equals] == [20]
    *others, (x, last) = found
    seeing = [*others, (x, replace(last, observes="images"))]
    _, equals = rivals(study(*(each for _, each in seeing)), seeing)
    assert [other for other, _ in equals] == [20]


def test_a_curve_is_a_table_a_sentence_and_a_drawing_beside_the_papers_points(points, study):
    curve = Curve(
        name="demonstrations", title="Success", axis="demonstrations", fit="saturating",
        points={f"bc_{x}": x for x in PLACES},
    )  # fmt: skip
    section = curve_section([study(*points, curves=(curve,))])
    assert section is not None
    (table,), (chart,) = section.tables, section.charts
    assert [row[0] for row in table.rows] == [str(x) for x in PLACES]
    assert [row[-1] for row in table.rows] == ["21%", "36%", "-", "-", "-", "-"]
    assert "The fitted curve tends to 80%" in table.note
    assert "too narrow" not in table.note
    few = [replace(point, models=point.models[:1]) for point in points]
    (table,) = curve_section([study(*few, curves=(curve,))]).tables
    assert table.note.endswith("too narrow where fewer than 3 models tell how far trainings differ.")
    assert chart.png.startswith(b"\x89PNG")
    assert chart.svg.startswith("<svg")
    assert "var(--accent)" in chart.svg
    assert chart.name == "one_leg_demonstrations"


def test_what_is_counted_has_no_halves_on_its_axis(result, study):
    curve = Curve(name="rounds", title="Success", axis="rounds", fit="none", points={"ta": 0, "ta_ci": 4})
    section = curve_section([study(result("ta", 0.5), result("ta_ci", 0.6), curves=(curve,))])
    assert section is not None
    (chart,) = section.charts
    labels = re.findall(r"<!-- (\S+) -->", chart.svg)
    assert {"0", "1", "4"} <= set(labels)
    assert not {label for label in labels if label.endswith((".5", ".0"))}


@pytest.mark.parametrize("points", [{"elsewhere": 1}, {"bc": 0, "elsewhere": 1}])
def test_a_curve_of_fewer_than_two_points_is_left_out(study, result, points):
    curve = Curve(name="c", title="C", axis="c", fit="none", points=points)
    assert curve_section([study(result("bc", 0.5), curves=(curve,))]) is None
