"""What may be concluded from several conditions: differences with intervals, and tests that allow for their number."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, zip_longest
from statistics import NormalDist

import numpy as np

from juicer.errors import ConfigError
from juicer.evaluation import (
    ConditionResult,
    Interval,
    PairedComparison,
    compare,
    student_interval,
)
from juicer.seeding import stream

LEVEL = 0.05
"""Below which a p-value is called a difference."""
DRAWS = 10_000
BETS = 1000


@dataclass(frozen=True)
class Difference:
    """Two conditions on the same initial states.

    Attributes:
        first: One of them.
        second: The other.
        test: Their episodes, pair by pair, and the p-value of :func:`state_p_value`.
        num_models: Pairs of models.
        interval: 95 % interval of the second's average minus the first's, over models, initial states and episodes.
        p_adjusted: The test's p-value, adjusted for the number of tests made together (Holm).
    """

    first: ConditionResult
    second: ConditionResult
    test: PairedComparison
    num_models: int
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
        return self.num_models > 1 and self.is_significant and not low <= 0 <= high

    @property
    def test_name(self) -> str:
        """Which test it is; of one model each, flipping the signs of initial states is McNemar's."""
        if self.num_models == 1:
            return self.test.test
        return f"{'an anytime-valid' if self.test.anytime else 'the exact'} sign-flip test over initial states"

    def __str__(self) -> str:
        """E.g. ``+12 points (4 to 20), p = 0.003``."""
        low, high = self.interval
        return f"{points(self.test.difference)} points ({points(low)} to {points(high)}), p {p_text(self.p_adjusted)}"


def differences(results: Sequence[ConditionResult], untrained: Collection[str] = ()) -> list[Difference]:
    """Every pair of conditions, the earlier one first.

    Args:
        results: The conditions.
        untrained: Names of those that no training seed changes: theirs is paired with every model of the others.
    """
    return _tested(combinations(results, 2), untrained)


def against(
    first: ConditionResult, others: Sequence[ConditionResult], untrained: Collection[str] = ()
) -> list[Difference]:
    """One condition with each of some others, which come second."""
    return _tested(((first, other) for other in others), untrained)


def _tested(pairs: Iterable[tuple[ConditionResult, ConditionResult]], untrained: Collection[str]) -> list[Difference]:
    """Those that can be paired, with p-values adjusted for their number."""
    found = []
    for first, second in pairs:
        one, other = _of_every_seed(first, second, untrained), _of_every_seed(second, first, untrained)
        try:
            test = compare(one, other)
        except ConfigError:
            continue  # other seeds or other initial states: there is nothing to pair
        signs = _signs(one, other)
        test = replace(test, p_value=state_p_value(_of_states(signs), anytime=test.anytime))
        found.append(Difference(first, second, test, len(signs), difference_interval(one, other), test.p_value))
    adjusted = holm([each.test.p_value for each in found])
    return [replace(each, p_adjusted=p_value) for each, p_value in zip(found, adjusted, strict=True)]


def _of_every_seed(result: ConditionResult, other: ConditionResult, untrained: Collection[str]) -> ConditionResult:
    if result.condition not in untrained or other.condition in untrained:
        return result
    only = result.models[0]
    return replace(result, models=tuple(replace(only, seed=model.seed) for model in other.models))


def holm(p_values: Sequence[float]) -> list[float]:
    """P-values adjusted so that all tests together err as rarely as one (Holm 1979), in the order given."""
    order = np.argsort(p_values)
    factors = np.arange(len(p_values), 0, -1)
    adjusted = np.empty(len(p_values))
    adjusted[order] = np.minimum(1.0, np.maximum.accumulate(np.asarray(p_values)[order] * factors))
    return [float(each) for each in adjusted]


def state_p_value(differences: Sequence[int], *, anytime: bool = False) -> float:
    """Exact two-sided p-value of the hypothesis that both of two conditions succeed equally often from every state.

    All models of both start from the same initial states, some of which suit one condition whatever its training seed.
    Episodes are therefore not independent, but states are: were the two alike, each state's difference would be as
    likely with the other sign. The p-value is the share of all ways to set the signs whose sum is at least as far
    from zero. With one model each it is McNemar's exact test.

    Args:
        differences: Of each initial state, in how many pairs of models only the second succeeded, minus in how many
            only the first did.
        anytime: Whether it has to hold however often one looks; see :func:`_anytime_p_value`.
    """
    if anytime:
        return _anytime_p_value(differences)
    chances = np.ones(1)
    for size in map(abs, differences):
        # Both signs of one more state, of sums from -n to n.
        chances = (np.pad(chances, (0, 2 * size)) + np.pad(chances, (2 * size, 0))) / 2
    sums = np.arange(len(chances)) - len(chances) // 2
    return float(min(1.0, chances[abs(sums) >= abs(sum(differences))].sum()))


def _anytime_p_value(differences: Sequence[int]) -> float:
    """The same however often one looks; of one model each it is :func:`~juicer.evaluation.anytime_p_value`.

    One over a test martingale: what a fortune of one has grown to, if it was spread evenly over the probability that a
    state where one model more succeeds has the sign of the better condition, and was put on each state's sign at the
    odds of a fair coin. A state whose difference is n counts as n such states that agree.
    """
    chance = (np.arange(BETS) + 0.5) / BETS
    log_odds = np.log(chance / (1 - chance))
    grown = np.zeros(BETS)
    for each, number in Counter(differences).items():
        grown += number * (math.log(2) - np.logaddexp(0.0, -each * log_odds))
    return min(1.0, float(np.exp(math.log(BETS) - np.logaddexp.reduce(grown))))


def difference_interval(first: ConditionResult, second: ConditionResult, level: float = 0.95) -> Interval:
    """Interval of the second's average minus the first's, over the seeds that both have and the episodes of each.

    A bootstrap that draws pairs of models, then pairs of episodes of each. It covers Student's interval of the pairs'
    differences as well, which of a few models is the only one that is wide enough, and an interval of the differences
    of initial states, from which all models started. That one has a width also where all ended alike (Agresti and Min
    2005), and holds although evaluations ended when something was settled, if they did. Where one of a pair was
    evaluated longer, its further episodes are not compared, as in :func:`~juicer.evaluation.compare`.
    """
    signs = _signs(first, second)
    counts = np.array([[each.count(sign) for sign in (1, -1, 0)] for each in signs])
    sizes = counts.sum(axis=1)
    rng = stream(0, "difference interval")
    models = rng.integers(len(counts), size=(DRAWS, len(counts)))
    drawn = rng.multinomial(sizes[models], (counts / sizes[:, None])[models])
    averages = np.mean((drawn[..., 0] - drawn[..., 1]) / sizes[models], axis=1)
    low, high = np.quantile(averages, [0.5 - level / 2, 0.5 + level / 2])
    intervals = [
        (float(low), float(high)),
        _interval_of_states(signs, level, anytime=first.anytime or second.anytime),
    ]
    if len(counts) > 1:
        intervals.append(student_interval(((counts[:, 0] - counts[:, 1]) / sizes).tolist(), level))
    return max(-1.0, min(each[0] for each in intervals)), min(1.0, max(each[1] for each in intervals))


def _signs(first: ConditionResult, second: ConditionResult) -> list[list[int]]:
    """For each pair of models, of each initial state, 1 if only the second succeeded, -1 if only the first did."""
    seconds = {model.seed: model.successes for model in second.models}
    return [
        [later - earlier for earlier, later in zip(model.successes, seconds[model.seed], strict=False)]
        for model in first.models
        if model.seed in seconds
    ]


def _of_states(signs: Sequence[Sequence[int]]) -> list[int]:
    """Sum of each initial state, over the pairs of models that came so far."""
    return [sum(state) for state in zip_longest(*signs, fillvalue=0)]


def _interval_of_states(signs: Sequence[Sequence[int]], level: float, *, anytime: bool) -> Interval:
    """Wald's interval of the mean of the states' differences, with half a state more of every outcome.

    If it has to hold however often one looks, it is as many standard errors wide as an asymptotic confidence sequence
    (Waudby-Smith, Arbour, Sinha, Kennedy and Ramdas 2024), one that is tightest after a hundred states.
    """
    reached = (np.arange(max(map(len, signs)))[:, None] < [len(each) for each in signs]).sum(axis=1)
    means = np.array(_of_states(signs)) / reached
    number = len(means) + 2
    middle = float(means.sum()) / number
    errors = _standard_errors_at_any_time(number, level) if anytime else NormalDist().inv_cdf(0.5 + level / 2)
    half = errors * math.sqrt(((float((means**2).sum()) + 1) / number - middle**2) / number)
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
    told = f"{100 * rate:+.0f}"
    return told if float(told) else "0"


def p_text(p_value: float) -> str:
    """E.g. ``= 0.012`` or ``< 0.001``."""
    return "< 0.001" if p_value < 0.001 else f"= {p_value:.3f}"
