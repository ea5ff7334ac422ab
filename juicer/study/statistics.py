"""What may be concluded from several conditions: differences with intervals, and tests that allow for their number."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from juicer.errors import ConfigError
from juicer.evaluation import ConditionResult, Interval, PairedComparison, compare, student_interval
from juicer.seeding import stream

LEVEL = 0.05
"""Below which a p-value is called a difference."""
DRAWS = 10_000


@dataclass(frozen=True)
class Difference:
    """Two conditions on the same initial states.

    Attributes:
        first: One of them.
        second: The other.
        test: McNemar's test on their episodes.
        interval: 95 % interval of the second's average minus the first's, over models and episodes.
        p_adjusted: The test's p-value, adjusted for the number of tests made together (Holm).
    """

    first: ConditionResult
    second: ConditionResult
    test: PairedComparison
    interval: Interval
    p_adjusted: float

    @property
    def is_significant(self) -> bool:
        """Whether the two succeed unequally often, all tests made together erring once in twenty."""
        return self.p_adjusted < LEVEL

    @property
    def is_clear(self) -> bool:
        """Whether the test and the interval both say so: the one speaks of these models, the other of their recipes.

        Of one model each nothing is clear: how far trainings of a recipe differ, two of them at least must tell.
        """
        low, high = self.interval
        return self.num_shared_seeds > 1 and self.is_significant and not low <= 0 <= high

    @property
    def num_shared_seeds(self) -> int:
        """Seeds of which both have a model."""
        return len({model.seed for model in self.first.models} & {model.seed for model in self.second.models})

    def __str__(self) -> str:
        """E.g. ``+12 points (4 to 20), p = 0.003``."""
        low, high = self.interval
        return f"{points(self.test.difference)} points ({points(low)} to {points(high)}), p {p_text(self.p_adjusted)}"


def differences(results: Sequence[ConditionResult]) -> list[Difference]:
    """Every pair of conditions, the earlier one first."""
    return _tested(combinations(results, 2))


def against(first: ConditionResult, others: Sequence[ConditionResult]) -> list[Difference]:
    """One condition with each of some others, which come second."""
    return _tested((first, other) for other in others)


def _tested(pairs: Iterable[tuple[ConditionResult, ConditionResult]]) -> list[Difference]:
    """Those that can be paired, with p-values adjusted for their number."""
    tests = []
    for first, second in pairs:
        try:
            tests.append((first, second, compare(first, second)))
        except ConfigError:
            continue  # other seeds or other initial states: there is nothing to pair
    adjusted = holm([test.p_value for _, _, test in tests])
    return [
        Difference(first, second, test, difference_interval(first, second), p_value)
        for (first, second, test), p_value in zip(tests, adjusted, strict=True)
    ]


def holm(p_values: Sequence[float]) -> list[float]:
    """P-values adjusted so that all tests together err as rarely as one (Holm 1979), in the order given."""
    order = np.argsort(p_values)
    factors = np.arange(len(p_values), 0, -1)
    adjusted = np.empty(len(p_values))
    adjusted[order] = np.minimum(1.0, np.maximum.accumulate(np.asarray(p_values)[order] * factors))
    return [float(each) for each in adjusted]


def difference_interval(first: ConditionResult, second: ConditionResult, level: float = 0.95) -> Interval:
    """Interval of the second's average minus the first's, over the seeds that both have and the episodes of each.

    A bootstrap that draws pairs of models, then pairs of episodes of each. It covers Student's interval of the pairs'
    differences as well, which of a few models is the only one that is wide enough, and an interval of the pooled pairs
    of episodes that has a width also where all of them ended alike (Agresti and Min 2005), and that holds although
    evaluations ended when something was settled, if they did. Where one of a pair was
    evaluated longer, its further episodes are not compared, as in :func:`~juicer.evaluation.compare`.
    """
    seconds = {model.seed: model.successes for model in second.models}
    signs = [
        [later - earlier for earlier, later in zip(model.successes, seconds[model.seed], strict=False)]
        for model in first.models
        if model.seed in seconds
    ]
    counts = np.array([[each.count(sign) for sign in (1, -1, 0)] for each in signs])
    sizes = counts.sum(axis=1)
    rng = stream(0, "difference interval")
    models = rng.integers(len(counts), size=(DRAWS, len(counts)))
    drawn = rng.multinomial(sizes[models], (counts / sizes[:, None])[models])
    averages = np.mean((drawn[..., 0] - drawn[..., 1]) / sizes[models], axis=1)
    low, high = np.quantile(averages, [0.5 - level / 2, 0.5 + level / 2])
    intervals = [
        (float(low), float(high)),
        _pooled_interval(counts.sum(axis=0), level, anytime=first.anytime or second.anytime),
    ]
    if len(counts) > 1:
        intervals.append(student_interval(((counts[:, 0] - counts[:, 1]) / sizes).tolist(), level))
    return max(-1.0, min(each[0] for each in intervals)), min(1.0, max(each[1] for each in intervals))


def _pooled_interval(counts: NDArray[np.int64], level: float, *, anytime: bool) -> Interval:
    """Wald's interval of a difference of paired rates, with half an episode more of every outcome.

    If it has to hold however often one looks, it is as many standard errors wide as an asymptotic confidence sequence
    (Waudby-Smith, Arbour, Sinha, Kennedy and Ramdas 2024), one that is tightest after a hundred pairs.
    """
    gained, lost, equal = counts.tolist()
    number = gained + lost + equal + 2
    middle = (gained - lost) / number
    errors = _standard_errors_at_any_time(number, level) if anytime else NormalDist().inv_cdf(0.5 + level / 2)
    half = errors * math.sqrt(((gained + lost + 1) / number - middle**2) / number)
    return middle - half, middle + half


def _standard_errors_at_any_time(number: int, level: float) -> float:
    error = 1 - level
    prior = 100 / (-2 * math.log(error) + math.log(1 - 2 * math.log(error)))
    return math.sqrt((1 + prior / number) * math.log((number + prior) / (prior * error**2)))


def models_differ(result: ConditionResult) -> float:
    """P-value of the hypothesis that all models of a condition succeed equally often (Cochran's Q test, 1950).

    The models start from the same initial states, of which some are harder for all of them; a test that took their
    episodes for independent would see less. Where one was evaluated longer, its further episodes do not count.
    """
    from scipy.stats import chi2  # takes half a second to import

    shared = min(len(model.successes) for model in result.models)
    table = np.array([model.successes[:shared] for model in result.models], float)
    number, of_models, of_states = len(table), table.sum(axis=1), table.sum(axis=0)
    spread = number * table.sum() - (of_states**2).sum()
    if spread == 0:
        return 1.0
    statistic = (number - 1) * (number * (of_models**2).sum() - table.sum() ** 2) / spread
    return float(chi2.sf(statistic, number - 1))


def points(rate: float) -> str:
    """A difference of rates in points of a hundred, with its sign."""
    return f"{100 * rate:+.0f}"


def p_text(p_value: float) -> str:
    """E.g. ``= 0.012`` or ``< 0.001``."""
    return "< 0.001" if p_value < 0.001 else f"= {p_value:.3f}"
