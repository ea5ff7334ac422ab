"""Success rates with intervals, and paired comparisons; :mod:`juicer.seed_ranges` has the initial states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from statistics import fmean

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


def hierarchical_interval(
    successes: Sequence[int], trials: Sequence[int], rng: np.random.Generator, level: float = 0.95, draws: int = 10_000
) -> Interval:
    """Interval of the average rate of a condition: over its trained models, and over episodes of each.

    A bootstrap that draws models, then episodes of each drawn model. It is never narrower than the Wilson
    interval of the pooled episodes, which also covers what no bootstrap sees: one model, or rates of 0 or 1.

    Args:
        successes: Successes of each model.
        trials: Episodes of each model.
        rng: Source of the draws.
        level: Confidence.
        draws: Bootstrap draws.
    """
    pooled = wilson_interval(sum(successes), sum(trials), level)
    if len(successes) == 1:
        return pooled
    counts = np.asarray(trials)
    rates = np.asarray(successes) / counts
    models = rng.integers(len(rates), size=(draws, len(rates)))
    averages = np.mean(rng.binomial(counts[models], rates[models]) / counts[models], axis=1)
    low, high = np.quantile(averages, [0.5 - level / 2, 0.5 + level / 2])
    return (min(float(low), pooled[0]), max(float(high), pooled[1]))


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
        shifted: The same models under each shift, by name; none under one that they cannot notice.
    """

    condition: str
    title: str
    models: tuple[ModelResult, ...]
    interval: Interval
    shifted: Mapping[str, ConditionResult | None] = field(default_factory=dict)

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


def summarise(condition: str, models: Sequence[ModelResult], title: str = "") -> ConditionResult:
    """Condition's row, with its interval; the same models give the same interval."""
    interval = hierarchical_interval(
        [sum(model.successes) for model in models],
        [len(model.successes) for model in models],
        stream(0, "hierarchical interval"),
    )
    return ConditionResult(condition, title or condition, tuple(models), interval)


@dataclass(frozen=True)
class PairedComparison:
    """Two conditions on the same initial states (McNemar's exact test).

    Attributes:
        first: Title of the first condition.
        second: Title of the second.
        first_only: Episodes in which only the first succeeded.
        second_only: Episodes in which only the second succeeded.
        num_pairs: Episodes compared.
        p_value: Two-sided, of the hypothesis that both succeed equally often. Episodes of one model are
            not independent of each other, so it speaks of these models, not of the recipes.
    """

    first: str
    second: str
    first_only: int
    second_only: int
    num_pairs: int
    p_value: float

    @property
    def difference(self) -> float:
        """Rate of the second minus rate of the first."""
        return (self.second_only - self.first_only) / self.num_pairs

    def __str__(self) -> str:
        """The comparison in a sentence."""
        return (
            f"{self.first} alone succeeded from {self.first_only} of {self.num_pairs} initial states, {self.second} "
            f"alone from {self.second_only}: p = {self.p_value:.2g} (McNemar's exact test)"
        )


def compare(first: ConditionResult, second: ConditionResult) -> PairedComparison:
    """Pair the models of two conditions by training seed and their episodes by initial state.

    Raises:
        ConfigError: If the two share no training seed, or were not evaluated on the same initial states.
    """
    seconds = {model.seed: model for model in second.models}
    pairs = [(model, seconds[model.seed]) for model in first.models if model.seed in seconds]
    if not pairs:
        raise ConfigError(f"'{first.title}' and '{second.title}' have no training seed in common")
    if any(left.initial_states != right.initial_states for left, right in pairs):
        raise ConfigError(f"'{first.title}' and '{second.title}' were evaluated on different initial states")
    left = np.concatenate([pair[0].successes for pair in pairs])
    right = np.concatenate([pair[1].successes for pair in pairs])
    first_only, second_only = int(np.sum(left & ~right)), int(np.sum(~left & right))
    return PairedComparison(
        first=first.title,
        second=second.title,
        first_only=first_only,
        second_only=second_only,
        num_pairs=len(left),
        p_value=mcnemar_p_value(first_only, second_only),
    )


def mcnemar_p_value(first_only: int, second_only: int) -> float:
    """Exact two-sided p-value of a discordance of ``first_only`` against ``second_only`` episodes."""
    from scipy.stats import binomtest  # takes half a second to import

    discordant = first_only + second_only
    return float(binomtest(first_only, discordant).pvalue) if discordant else 1.0


def milestone_counts(milestones: Sequence[Mapping[str, int]], names: Sequence[str]) -> dict[str, int]:
    """Episodes that reached each milestone, in the order of ``names``; shows where a policy fails.

    Args:
        milestones: For each episode, the step at which each reached milestone was reached.
        names: All milestones of the task, in order.
    """
    return {name: sum(name in reached for reached in milestones) for name in names}
