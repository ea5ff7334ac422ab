"""The points of a curve, and what they say."""

from __future__ import annotations

from collections.abc import Sequence

from juicer.evaluation import ConditionResult
from juicer.study.curves import Curve, Saturation, fit_saturation
from juicer.study.material import TaskStudy
from juicer.study.statistics import against

Points = Sequence[tuple[float, ConditionResult]]
"""Number and result of each condition of a curve, in the order of the numbers."""


def curve_points(study: TaskStudy, curve: Curve) -> Points:
    """Those of a curve that have results."""
    found = [(x, result) for name, x in curve.points.items() if (result := study.result(name))]
    return sorted(found, key=lambda point: point[0])


def fit_of(curve: Curve, found: Points) -> Saturation | None:
    """What is drawn through the points, if anything is and can be."""
    if curve.fit == "none":
        return None
    return fit_saturation([x for x, _ in found], [result for _, result in found])


def rivals(study: TaskStudy, found: Points) -> tuple[tuple[float, ConditionResult], Points]:
    """The best point, and those that cannot be told apart from it, all tested against it together."""
    x, best = max(found, key=lambda point: point[1].average)
    others = [(place, result) for place, result in found if result is not best and study.are_paired(result, best)]
    worse = {each.second.condition for each in against(best, [result for _, result in others]) if each.is_clear}
    return (x, best), [(place, result) for place, result in others if result.condition not in worse]


def rounded(number: float) -> str:
    """Two digits of a number that is known no better, e.g. ``340`` or ``0.12``."""
    return f"{float(f'{number:.2g}'):g}"
