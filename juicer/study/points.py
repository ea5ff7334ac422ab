"""The points of a curve, and what they say."""

from __future__ import annotations

from collections.abc import Sequence

from juicer.evaluation import ConditionResult
from juicer.study.curves import Curve, Saturation, fit_saturation
from juicer.study.material import TaskStudy
from juicer.study.statistics import differences

FITTED = 3
"""Models a point below which a fitted curve's intervals are too narrow."""
Points = Sequence[tuple[float, ConditionResult]]
"""Number and result of each condition of a curve, in the order of the numbers."""


def curve_points(study: TaskStudy, curve: Curve) -> Points:
    """Those of a curve that have results."""
    found = [(x, result) for name, x in curve.points.items() if (result := study.result(name))]
    return sorted(found, key=lambda point: point[0])


def can_be_drawn(found: Points) -> bool:
    """Whether there is a curve: one point is none."""
    return len(found) > 1


def fit_of(curve: Curve, found: Points) -> Saturation | None:
    """What is drawn through the points, if anything is and can be."""
    if curve.fit == "none":
        return None
    return fit_saturation([x for x, _ in found], [result for _, result in found])


def rivals(study: TaskStudy, found: Points) -> tuple[tuple[float, ConditionResult], Points]:
    """The best point, and those that are not known to be worse.

    All pairs are tested together: which point is the best is told by the same episodes as that it is better. What
    cannot be paired with it, for it starts from other states or has other seeds, is not known to be worse either.
    """
    x, best = max(found, key=lambda point: point[1].average)
    worse = set()
    for each in differences([result for _, result in found if study.are_paired(result, best)]):
        if each.is_clear and each.first is best and each.test.difference < 0:
            worse.add(each.second.condition)
        if each.is_clear and each.second is best and each.test.difference > 0:
            worse.add(each.first.condition)
    others = [point for point in found if point[1] is not best and point[1].condition not in worse]
    return (x, best), others


def rounded(number: float) -> str:
    """Two digits of a number that is known no better, e.g. ``340`` or ``0.12``."""
    return f"{float(f'{number:.2g}'):g}"
