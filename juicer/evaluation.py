"""Success rates with intervals, and paired comparisons; :mod:`juicer.seed_ranges` has the initial states."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from statistics import fmean, stdev

import numpy as np

from juicer.errors import ConfigError
from juicer.seeding import stream

Interval = tuple[float, float]
"""Lower and upper end of a confidence interval of a rate, each in [0, 1]."""


def wilson_interval(successes: int, trials: int, level: float = 0.95) -> Interval:
    """Wilson score interval of a rate.

    Raises:
        ValueError: If there are no trials, or more successes than trials.
    """
    if not 0 <= successes <= trials or trials == 0:
        raise ValueError(f"{successes} successes in {trials} trials do not make a rate")
    from scipy.stats import binomtest  # takes half a second to import

    interval = binomtest(successes, trials).proportion_ci(level, method="wilson")
    return (float(interval.low), float(interval.high))


def anytime_interval(successes: int, trials: int, level: float = 0.95) -> Interval:
    """Interval of a rate that may be looked at after every episode, to decide whether to go on.

    With probability ``level`` it holds the true rate after every number of episodes, so also where one stops. Wilson's
    does not: looked at after each of 100 episodes, it leaves out the true rate in about a quarter of all runs.

    It consists of the rates that are not refuted: the likelihood of the outcomes under a uniform mixture of rates is
    less than ``1 / (1 - level)`` times that under the rate, a ratio which is a test martingale (Ville 1939; Robbins
    1970; Howard, Ramdas, McAuliffe and Sekhon 2021, "Time-uniform, nonparametric, nonasymptotic confidence sequences").

    Episodes of several models, as many of each, may be pooled, and the interval is that of their average rate, if
    outcomes of two models from one initial state are independent given their rates: one episode of each multiplies the
    ratio by factors that are linear in the models' rates and are 1 at their average, so the product of their
    expectations is at most 1 (a geometric mean is at most the arithmetic one). If they are not, as where some states
    are hard for all, it covers less: of five models, looked at in four blocks of 25 states, 97 % at a correlation of
    0.19 and 92 % at 0.33; looked at after every state, 85 % and 71 %.

    Raises:
        ValueError: If there are no trials, or more successes than trials.
    """
    if not 0 <= successes <= trials or trials == 0:
        raise ValueError(f"{successes} successes in {trials} trials do not make a rate")
    from scipy.optimize import brentq
    from scipy.special import betaln, xlog1py, xlogy

    failures, rate = trials - successes, successes / trials
    mixture = float(betaln(successes + 1, failures + 1)) + math.log(1 - level)

    def margin(candidate: float) -> float:
        return float(xlogy(successes, candidate) + xlog1py(failures, -candidate)) - mixture

    return (
        float(brentq(margin, 0, rate)) if successes else 0.0,
        float(brentq(margin, rate, 1)) if failures else 1.0,
    )


def hierarchical_interval(
    successes: Sequence[int],
    trials: Sequence[int],
    rng: np.random.Generator,
    level: float = 0.95,
    draws: int = 10_000,
    of_episodes: Callable[[int, int, float], Interval] = wilson_interval,
) -> Interval:
    """Interval of the average rate of a condition: over its trained models, and over episodes of each.

    A bootstrap that draws models, then episodes of each drawn model, and Student's interval of the models' rates: of a
    few models, a bootstrap alone covers the rate of a recipe too rarely (of two, four times in five). It is never
    narrower than the interval of the pooled episodes, which also covers what neither sees: one model, or rates of 0 or
    1. Of one model it is the interval of its episodes, and tells nothing of other trainings.

    Args:
        successes: Successes of each model.
        trials: Episodes of each model.
        rng: Source of the draws.
        level: Confidence.
        draws: Bootstrap draws.
        of_episodes: Interval of the pooled episodes.
    """
    pooled = of_episodes(sum(successes), sum(trials), level)
    if len(successes) == 1:
        return pooled
    counts = np.asarray(trials)
    rates = np.asarray(successes) / counts
    models = rng.integers(len(rates), size=(draws, len(rates)))
    averages = np.mean(rng.binomial(counts[models], rates[models]) / counts[models], axis=1)
    low, high = np.quantile(averages, [0.5 - level / 2, 0.5 + level / 2])
    least, most = student_interval(rates.tolist(), level)
    return (max(0.0, min(float(low), pooled[0], least)), min(1.0, max(float(high), pooled[1], most)))


def student_interval(values: Sequence[float], level: float = 0.95) -> Interval:
    """Student's interval of the mean that two values or more were drawn around."""
    from scipy.stats import t  # takes half a second to import

    mean, half = fmean(values), float(t.ppf(0.5 + level / 2, len(values) - 1)) * stdev(values) / math.sqrt(len(values))
    return mean - half, mean + half


@dataclass(frozen=True)
class ModelResult:
    """Evaluation of one trained model.

    Attributes:
        seed: Root seed of its training.
        initial_states: Seeds of the initial states, in order.
        successes: Whether the episode from each initial state succeeded.
    """

    seed: int
    initial_states: tuple[int, ...]
    successes: tuple[bool, ...]

    def __post_init__(self) -> None:
        if len(self.initial_states) != len(self.successes) or not self.successes:
            raise ValueError("a model's result needs one success or failure for each of its initial states")

    @property
    def rate(self) -> float:
        """Share of successes."""
        return fmean(self.successes)


@dataclass(frozen=True)
class ConditionResult:
    """A row of the comparison in the form of the paper's Table VI.

    Attributes:
        condition: Its name, e.g. ``ta_ci``.
        title: What people read instead, e.g. ``TA+CI``.
        models: One result a trained model.
        interval: 95 % interval of the average, over models and episodes.
        anytime: Whether its evaluation ended when something was settled, so that only what holds at any time may be
            said of it.
        shifted: The same models under each shift, by name; none under one that they cannot notice.
        observes: What its policies saw, and what they were taught with beside; empty if that is not known.
    """

    condition: str
    title: str
    models: tuple[ModelResult, ...]
    interval: Interval
    anytime: bool = False
    shifted: Mapping[str, ConditionResult | None] = field(default_factory=dict)
    observes: str = ""

    @property
    def average(self) -> float:
        """Mean of the models' rates."""
        return fmean(model.rate for model in self.models)

    @property
    def best(self) -> float:
        """Rate of the best single model."""
        return max(model.rate for model in self.models)

    @property
    def num_models(self) -> int:
        """Trained models."""
        return len(self.models)

    @property
    def num_episodes(self) -> int:
        """Episodes of all models together."""
        return sum(len(model.successes) for model in self.models)


def summarise(
    condition: str, models: Sequence[ModelResult], title: str = "", *, anytime: bool = False
) -> ConditionResult:
    """Condition's row, with its interval; the same models give the same interval."""
    interval = hierarchical_interval(
        [sum(model.successes) for model in models],
        [len(model.successes) for model in models],
        stream(0, "hierarchical interval"),
        of_episodes=anytime_interval if anytime else wilson_interval,
    )
    return ConditionResult(condition, title or condition, tuple(models), interval, anytime)


@dataclass(frozen=True)
class PairedComparison:
    """Two conditions on the same initial states (McNemar's exact test, or its anytime-valid form).

    Attributes:
        first: Title of the first condition.
        second: Title of the second.
        first_only: Episodes in which only the first succeeded.
        second_only: Episodes in which only the second succeeded.
        num_pairs: Episodes compared.
        p_value: Two-sided, of the hypothesis that both succeed equally often. Episodes of one model are
            not independent of each other, so it speaks of these models, not of the recipes.
        anytime: Whether it holds although the number of pairs depended on what was found; see
            :func:`anytime_p_value`.
    """

    first: str
    second: str
    first_only: int
    second_only: int
    num_pairs: int
    p_value: float
    anytime: bool = False

    @property
    def test(self) -> str:
        """Which test it is of."""
        return "McNemar's test in its anytime-valid form" if self.anytime else "McNemar's exact test"

    @property
    def difference(self) -> float:
        """Rate of the second minus rate of the first."""
        return (self.second_only - self.first_only) / self.num_pairs

    def __str__(self) -> str:
        """The comparison in a sentence."""
        return (
            f"{self.first} alone succeeded from {self.first_only} of {self.num_pairs} initial states, {self.second} "
            f"alone from {self.second_only}: p = {self.p_value:.2g} ({self.test})"
        )


def compare(first: ConditionResult, second: ConditionResult) -> PairedComparison:
    """Pair the models of two conditions by training seed and their episodes by initial state.

    Where one of them was evaluated longer, its further episodes are not compared.

    Raises:
        ConfigError: If the two share no training seed, or were not evaluated on the same initial states.
    """
    seconds = {model.seed: model for model in second.models}
    both = [(model, seconds[model.seed]) for model in first.models if model.seed in seconds]
    if not both:
        raise ConfigError(f"'{first.title}' and '{second.title}' have no training seed in common")
    # One that was evaluated longer began with the same initial states.
    starts = [state for pair in both for state in zip(*(model.initial_states for model in pair), strict=False)]
    if any(left != right for left, right in starts):
        raise ConfigError(f"'{first.title}' and '{second.title}' were evaluated on different initial states")
    ends = [end for pair in both for end in zip(*(model.successes for model in pair), strict=False)]
    first_only, second_only = ends.count((True, False)), ends.count((False, True))
    anytime = first.anytime or second.anytime
    p_value = (anytime_p_value if anytime else mcnemar_p_value)(first_only, second_only)
    return PairedComparison(first.title, second.title, first_only, second_only, len(ends), p_value, anytime)


def mcnemar_p_value(first_only: int, second_only: int) -> float:
    """Exact two-sided p-value of a discordance of ``first_only`` against ``second_only`` episodes."""
    from scipy.stats import binomtest  # takes half a second to import

    discordant = first_only + second_only
    return float(binomtest(first_only, discordant).pvalue) if discordant else 1.0


def anytime_p_value(first_only: int, second_only: int) -> float:
    """The same for a comparison that may be looked at after every pair, to decide whether to go on.

    However often one looks, it ever falls to a level with at most that probability if both succeed equally often. It is
    one over the likelihood of the discordant episodes under a uniform mixture of coins, relative to a fair coin's: a
    test martingale, as in :func:`anytime_interval`, which also says why episodes of several models may be pooled.
    """
    from scipy.special import betaln

    evidence = float(betaln(first_only + 1, second_only + 1)) + (first_only + second_only) * math.log(2)
    return min(1.0, math.exp(-evidence))


def milestone_counts(milestones: Sequence[Mapping[str, int]], names: Sequence[str]) -> dict[str, int]:
    """Episodes that reached each milestone, in the order of ``names``; shows where a policy fails.

    Args:
        milestones: For each episode, the step at which each reached milestone was reached.
        names: All milestones of the task, in order.
    """
    return {name: sum(name in reached for reached in milestones) for name in names}
