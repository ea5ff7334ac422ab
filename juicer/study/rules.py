"""How a statement of the paper is judged by results: each rule is data, and says what its verdict rests on."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

from juicer.analysis.sampling import CHANCE
from juicer.reporting.comparison import by_observation
from juicer.study.curves import Curve
from juicer.study.material import TaskStudy
from juicer.study.points import FITTED, curve_points, fit_of, rivals, rounded
from juicer.study.statistics import LEVEL, Difference, against, models_differ, p_text, points
from juicer.study.success import interval_text, percent

NEGLIGIBLE = 0.03
"""By how much one condition may be better than another and still as good [rate of success]."""
_ONE_SEED = "of one seed, where two at least must tell how far trainings differ"


class Ruling(StrEnum):
    """What becomes of a statement."""

    HOLDS = "holds"
    FAILS = "does not hold"
    OPEN = "cannot be told"
    UNTESTED = "not tested"


@dataclass(frozen=True)
class Verdict:
    """A ruling, and what it rests on."""

    ruling: Ruling
    reason: str


class Rule(Protocol):
    """Judges a statement by the results of one task."""

    def judge(self, study: TaskStudy) -> Verdict:
        """What the results say."""
        ...


@dataclass(frozen=True)
class Better:
    """One condition succeeds more often than another: their paired test says so, and none the other way.

    It does not hold either where the interval leaves no room for more than a negligible advantage, unless the other
    condition itself leaves none.

    Attributes:
        better: The one.
        than: The other.
        settings: Whether the statement is about what the two change in the configuration, and not about their methods.
    """

    better: str
    than: str
    settings: bool = False

    def judge(self, study: TaskStudy) -> Verdict:
        """What the paired test says."""
        if missing := _missing(study, self.better, self.than, settings=self.settings):
            return Verdict(Ruling.UNTESTED, missing)
        first, second = study.measured[self.than].result, study.measured[self.better].result
        for found in against(first, [second], study.untrained):
            ruling, why = _ruling(found)
            return Verdict(ruling, f"{second.title} against {first.title}: {found}{why and f'; {why}'}")
        return Verdict(Ruling.UNTESTED, "they have no seed in common")


@dataclass(frozen=True)
class Best:
    """One condition succeeds more often than each of some others, all tested together."""

    best: str
    among: tuple[str, ...]

    def judge(self, study: TaskStudy) -> Verdict:
        """What the paired tests against each of the others say."""
        if missing := _missing(study, self.best, *self.among):
            return Verdict(Ruling.UNTESTED, missing)
        best = study.measured[self.best].result
        others = [study.measured[name].result for name in self.among]
        found = against(best, others, study.untrained)
        compared = {each.second.condition for each in found}
        if lacking := [other.title for other in others if other.condition not in compared]:
            return Verdict(Ruling.UNTESTED, f"{best.title} has no seed in common with {', '.join(lacking)}")
        above = [each.second.title for each in found if each.is_clear and each.test.difference > 0]
        equal = [f"{each.second.title} ({points(-each.test.difference)})" for each in found if not each.is_clear]
        if above:
            return Verdict(Ruling.FAILS, f"{', '.join(above)} succeeds more often")
        if equal:
            told = f"cannot be told apart from {', '.join(equal)}"
            alone = any(each.num_models == 1 for each in found)
            return Verdict(Ruling.OPEN, f"{told}; {_ONE_SEED}" if alone else told)
        return Verdict(Ruling.HOLDS, f"{percent(best.average)}, above each of the {len(found)} others (Holm)")


@dataclass(frozen=True)
class AtMost:
    """A condition succeeds no more often than that."""

    condition: str
    rate: float

    def judge(self, study: TaskStudy) -> Verdict:
        """On which side the interval lies."""
        if missing := _missing(study, self.condition):
            return Verdict(Ruling.UNTESTED, missing)
        result = study.measured[self.condition].result
        low, high = result.interval
        told = f"{result.title}: {percent(result.average)} ({interval_text(result.interval)})"
        if result.num_models == 1:
            return Verdict(Ruling.OPEN, f"{told}; {_ONE_SEED}")
        return Verdict(Ruling.HOLDS if high <= self.rate else Ruling.FAILS if low > self.rate else Ruling.OPEN, told)


@dataclass(frozen=True)
class ModelsDiffer:
    """Models of a condition that were trained alike succeed unequally often, by more than chance."""

    condition: str

    def judge(self, study: TaskStudy) -> Verdict:
        """What Cochran's test over the models says."""
        if missing := _missing(study, self.condition):
            return Verdict(Ruling.UNTESTED, missing)
        result = study.measured[self.condition].result
        if result.num_models < 3:
            return Verdict(Ruling.UNTESTED, f"three models of {self.condition} at least are needed")
        if result.anytime:
            told = "its evaluations ended when something was settled, for which there is no such test"
            return Verdict(Ruling.OPEN, f"{result.title}: {told}")
        p_value = models_differ(result)
        ruling = Ruling.HOLDS if p_value < LEVEL else Ruling.OPEN
        return Verdict(
            ruling,
            f"{result.title}: best {percent(result.best)}, average {percent(result.average)} of {result.num_models} "
            f"models; p {p_text(p_value)} (Cochran's Q)",
        )


@dataclass(frozen=True)
class Saturates:
    """A fitted curve comes within a twentieth of its plateau by some number."""

    curve: str
    by: float

    def judge(self, study: TaskStudy) -> Verdict:
        """On which side the interval of that number lies."""
        curve = _curve(study, self.curve)
        found = curve_points(study, curve) if curve else []
        fit = fit_of(curve, found) if curve else None
        if fit is None:
            return Verdict(Ruling.UNTESTED, f"curve {self.curve} has no results, or too few to fit")
        low, high = fit.enough_interval
        told = f"95% of a plateau of {percent(fit.top)} at {rounded(fit.enough)} ({rounded(low)} to {rounded(high)})"
        if any(result.num_models < FITTED for _, result in found):
            return Verdict(Ruling.OPEN, f"{told}; {FITTED} models a point at least are needed")
        if not fit.is_seen:
            return Verdict(Ruling.OPEN, f"{told}, which lies beyond the points")
        return Verdict(Ruling.HOLDS if high <= self.by else Ruling.FAILS if low > self.by else Ruling.OPEN, told)


@dataclass(frozen=True)
class BestWithin:
    """The best point of a curve lies between two numbers, and is better than all points outside."""

    curve: str
    low: float
    high: float

    def judge(self, study: TaskStudy) -> Verdict:
        """Where the best point is, and which others cannot be told apart from it."""
        curve = _curve(study, self.curve)
        found = curve_points(study, curve) if curve else []
        if curve is None or len(found) < 2:
            return Verdict(Ruling.UNTESTED, f"curve {self.curve} has no results")
        measured = [self._is_inside(each) for each, _ in found]
        if all(measured) or not any(measured):
            return Verdict(Ruling.UNTESTED, f"curve {self.curve} has no results on both sides of its bounds")
        (x, best), equals = rivals(study, found)
        inside = [self._is_inside(each) for each in (x, *(other for other, _ in equals))]
        ruling = Ruling.HOLDS if all(inside) else Ruling.OPEN if any(inside) else Ruling.FAILS
        others = ", ".join(f"{other:g}" for other, _ in equals)
        reason = f"best at {x:g} ({percent(best.average)})" + (f"; not to be told apart: {others}" if others else "")
        if any(result.num_models == 1 for _, result in found):
            return Verdict(Ruling.OPEN, f"{reason}; {_ONE_SEED}")
        return Verdict(ruling, reason)

    def _is_inside(self, x: float) -> bool:
        return self.low <= x <= self.high


@dataclass(frozen=True)
class SampledAlike:
    """What is drawn in few steps of the sampler is distributed as what is drawn in the most.

    Attributes:
        steps: The few.
        within: Distance that makes no difference [standard deviations].
    """

    steps: int
    within: float

    def judge(self, study: TaskStudy) -> Verdict:
        """On which side the distance of every analysed model lies, were it not for chance."""
        found = [(row, shown.apart) for row, shown in study.analyses if str(self.steps) in shown.apart]
        if not found:
            return Verdict(Ruling.UNTESTED, f"no analysis of samples that were drawn in {self.steps} steps and in more")
        rulings = {self._ruling(apart[str(self.steps)], apart[CHANCE]) for _, apart in found}
        told = "; ".join(
            f"{row.title}, seed {row.seed}: {apart[str(self.steps)]:.2f} (chance alone {apart[CHANCE]:.2f})"
            for row, apart in found
        )
        return Verdict(
            rulings.pop() if len(rulings) == 1 else Ruling.OPEN,
            f"{told} standard deviations from the most steps, where up to {self.within:g} makes no difference",
        )

    def _ruling(self, apart: float, chance: float) -> Ruling:
        if apart <= self.within:
            return Ruling.HOLDS
        return Ruling.FAILS if apart - chance > self.within else Ruling.OPEN


@dataclass(frozen=True)
class Untested:
    """Nothing here can judge it."""

    reason: str

    def judge(self, study: TaskStudy) -> Verdict:
        """Why not."""
        return Verdict(Ruling.UNTESTED, self.reason)


def _ruling(found: Difference) -> tuple[Ruling, str]:
    """Whether the second of two conditions is better, and why that is not said by the difference itself."""
    if found.is_clear:
        return Ruling.HOLDS if found.test.difference > 0 else Ruling.FAILS, ""
    if found.num_models == 1:
        return Ruling.OPEN, _ONE_SEED
    if found.first.average > 1 - NEGLIGIBLE:
        return Ruling.OPEN, f"{found.first.title} leaves no room to be better"
    if found.interval[1] <= NEGLIGIBLE:
        return Ruling.FAILS, f"if it is better at all, then by no more than {100 * NEGLIGIBLE:.0f} points"
    return Ruling.OPEN, ""


def _missing(study: TaskStudy, *conditions: str, settings: bool = False) -> str:
    """Why some conditions cannot be compared, whose settings may differ or not; empty if they can."""
    if missing := [name for name in conditions if name not in study.measured]:
        return f"no result of {', '.join(missing)}"
    compared = [study.measured[name] for name in conditions]
    if not settings and (
        told := "; ".join(f"{each.result.title}: {each.setting}" for each in compared if each.setting)
    ):
        return f"the statement is about methods alone, and more is changed ({told})"
    first, *others = (each.result for each in compared)
    if len(by_observation([first, *others])) > 1:
        return "their policies do not see the same"
    if all(study.are_paired(first, other) for other in others):
        return ""
    return "their episodes start from different states, or may take longer"


def _curve(study: TaskStudy, name: str) -> Curve | None:
    return next((curve for curve in study.curves if curve.name == name), None)
