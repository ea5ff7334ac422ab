"""Claims about intervals and comparisons."""

from __future__ import annotations

import math
from functools import cache
from statistics import NormalDist

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from juicer.errors import ConfigError
from juicer.evaluation import (
    ModelResult,
    anytime_interval,
    anytime_p_value,
    compare,
    hierarchical_interval,
    mcnemar_p_value,
    milestone_counts,
    summarise,
    wilson_interval,
)
from juicer.seeding import stream


def result(seed: int, successes: str, first_state: int = 0) -> ModelResult:
    """Model result from a string of ``1`` for success and ``0`` for failure."""
    states = tuple(range(first_state, first_state + len(successes)))
    return ModelResult(seed=seed, initial_states=states, successes=tuple(letter == "1" for letter in successes))


@settings(deadline=None)  # the first example imports SciPy's statistics
@given(trials=st.integers(1, 400), share=st.floats(0, 1))
def test_ends_of_wilsons_interval_are_as_unlikely_as_they_should_be(trials: int, share: float):
    successes = round(share * trials)
    z = NormalDist().inv_cdf(0.975)
    for end in wilson_interval(successes, trials):
        if 0 < end < 1:
            deviation = abs(successes / trials - end)
            assert deviation == pytest.approx(z * math.sqrt(end * (1 - end) / trials), abs=1e-12)
    assert (wilson_interval(0, trials)[0], wilson_interval(trials, trials)[1]) == (0, 1)


@pytest.mark.parametrize(("trials", "points"), [(50, 13), (100, 9.5), (500, 4.3)])
def test_wilson_half_width_at_59_percent(trials: int, points: float):
    low, high = wilson_interval(round(0.59 * trials), trials)
    assert 50 * (high - low) == pytest.approx(points, abs=0.3)


@pytest.mark.parametrize(("successes", "trials"), [(0, 0), (3, 2), (-1, 2)])
def test_wilson_interval_needs_a_rate(successes: int, trials: int):
    with pytest.raises(ValueError, match="do not make a rate"):
        wilson_interval(successes, trials)


@settings(deadline=None)
@given(trials=st.integers(1, 400), share=st.floats(0, 1))
def test_an_anytime_interval_holds_the_rates_that_are_not_refuted(trials: int, share: float):
    successes = round(share * trials)
    low, high = anytime_interval(successes, trials)
    assert low <= successes / trials <= high
    assert (low == 0, high == 1) == (successes == 0, successes == trials)
    mixture = 1 / ((trials + 1) * math.comb(trials, successes))
    for end in (low, high):
        if 0 < end < 1:
            likelihood = successes * math.log(end) + (trials - successes) * math.log1p(-end)
            assert math.log(mixture) - likelihood == pytest.approx(math.log(20), abs=1e-6)


def ever_missed(interval, paths: np.ndarray, truth: float) -> float:
    """Share of paths ``(N, T)`` of successes on which an interval misses the truth after some fifth episode."""
    cached = cache(interval)
    looks = range(5, paths.shape[1] + 1, 5)
    successes = np.cumsum(paths, axis=1)
    intervals = [[cached(int(path[look - 1]), look) for look in looks] for path in successes]
    return float(np.mean([any(not low <= truth <= high for low, high in each) for each in intervals]))


@pytest.mark.parametrize("rates", [[0.5], [0.81], [0.98], [0.5, 1.0]])
def test_looking_again_and_again_misses_the_rate_no_more_often_than_the_level_allows(rates: list[float]):
    # Of several models, the average rate: their episodes take turns.
    paths = np.random.default_rng(0).random((400, 100)) < np.resize(rates, 100)
    assert ever_missed(anytime_interval, paths, float(np.mean(rates))) <= 0.05
    if rates == [0.81]:
        assert ever_missed(wilson_interval, paths, 0.81) > 0.12


@pytest.mark.parametrize(("successes", "trials"), [(0, 0), (3, 2), (-1, 2)])
def test_an_anytime_interval_needs_a_rate(successes: int, trials: int):
    with pytest.raises(ValueError, match="do not make a rate"):
        anytime_interval(successes, trials)


def test_a_condition_that_may_have_stopped_is_told_with_an_anytime_interval():
    row = summarise("TA", [result(0, "1" * 25)], anytime=True)
    assert row.anytime
    assert row.interval == anytime_interval(25, 25)
    assert row.interval[0] < summarise("TA", [result(0, "1" * 25)]).interval[0]


def test_interval_of_one_model_is_wilsons():
    assert hierarchical_interval([59], [100], stream(0)) == wilson_interval(59, 100)


def test_disagreeing_models_widen_the_interval():
    agreeing = hierarchical_interval([50] * 5, [100] * 5, stream(0))
    disagreeing = hierarchical_interval([20, 35, 50, 65, 80], [100] * 5, stream(0))
    assert disagreeing[0] < agreeing[0] < 0.5 < agreeing[1] < disagreeing[1]


def test_interval_of_models_that_always_fail_is_not_empty():
    low, high = hierarchical_interval([0, 0], [100, 100], stream(0))
    assert low == 0
    assert high == pytest.approx(wilson_interval(0, 200)[1])


def test_hierarchical_interval_covers_the_true_rate():
    rng = np.random.default_rng(0)
    covered = 0
    for _ in range(200):
        rates = np.clip(rng.normal(0.6, 0.08, 5), 0, 1)
        low, high = hierarchical_interval(list(rng.binomial(50, rates)), [50] * 5, rng, draws=500)
        covered += low <= 0.6 <= high
    assert covered >= 185


@pytest.mark.parametrize("models", [2, 3])
def test_interval_of_a_few_models_covers_the_rate_of_their_recipe(models):
    rng = np.random.default_rng(0)
    covered = 0
    for _ in range(200):
        rates = np.clip(rng.normal(0.8, 0.08, models), 0, 1)
        low, high = hierarchical_interval(list(rng.binomial(100, rates)), [100] * models, rng, draws=500)
        covered += low <= 0.8 <= high
    assert covered >= 185


def test_row_has_average_best_and_counts_as_table_vi_does():
    row = summarise("TA", [result(0, "1100"), result(1, "1110")])
    assert (row.average, row.best, row.num_models, row.num_episodes) == (0.625, 0.75, 2, 8)
    assert row.interval[0] < row.average < row.interval[1]


def test_average_counts_models_alike_whatever_their_number_of_episodes():
    assert summarise("TA", [result(0, "1"), result(1, "000")]).average == 0.5


def test_the_same_models_give_the_same_interval():
    models = [result(0, "110010"), result(1, "111010")]
    assert summarise("TA", models) == summarise("TA", models)


def test_result_needs_an_outcome_for_each_initial_state():
    with pytest.raises(ValueError, match="each of its initial states"):
        ModelResult(seed=0, initial_states=(1, 2), successes=(True,))


@settings(deadline=None)
@given(first_only=st.integers(0, 60), second_only=st.integers(0, 60))
def test_mcnemar_counts_the_fair_coins_that_are_as_uneven(first_only: int, second_only: int):
    tosses, fewer = first_only + second_only, min(first_only, second_only)
    as_uneven = 2 * sum(math.comb(tosses, heads) for heads in range(fewer + 1)) / 2**tosses
    assert mcnemar_p_value(first_only, second_only) == pytest.approx(min(1.0, as_uneven), abs=1e-12)


def test_comparison_pairs_episodes_by_model_and_initial_state():
    bc = summarise("BC", [result(0, "1000"), result(1, "0100")])
    ta = summarise("TA", [result(1, "0111"), result(0, "1110")])
    comparison = compare(bc, ta)
    assert (comparison.first_only, comparison.second_only, comparison.num_pairs) == (0, 4, 8)
    assert comparison.difference == 0.5
    assert comparison.p_value == pytest.approx(0.125)


def test_comparison_leaves_out_models_without_a_partner():
    assert (
        compare(summarise("BC", [result(0, "10")]), summarise("TA", [result(0, "11"), result(1, "11")])).num_pairs == 2
    )


def test_different_initial_states_cannot_be_compared():
    with pytest.raises(ConfigError, match="different initial states"):
        compare(summarise("BC", [result(0, "10")]), summarise("TA", [result(0, "10", first_state=7)]))


def test_conditions_without_a_common_seed_cannot_be_compared():
    with pytest.raises(ConfigError, match="no training seed in common"):
        compare(summarise("BC", [result(0, "10")]), summarise("TA", [result(1, "10")]))


@given(first_only=st.integers(0, 60), second_only=st.integers(0, 60))
def test_the_anytime_p_value_is_one_over_what_a_gambler_on_all_coins_has_won(first_only: int, second_only: int):
    tosses = first_only + second_only
    won = 2**tosses / ((tosses + 1) * math.comb(tosses, first_only))
    assert anytime_p_value(first_only, second_only) == pytest.approx(min(1, 1 / won), rel=1e-9)


def test_comparing_after_every_pair_decides_between_equals_no_more_often_than_the_level_allows():
    first = np.random.default_rng(0).random((2000, 100)) < 0.5
    ever = {"anytime": 0, "mcnemar": 0}
    tables = {"anytime": cache(anytime_p_value), "mcnemar": cache(mcnemar_p_value)}
    for path in first:
        counts = list(zip(np.cumsum(path).tolist(), np.cumsum(~path).tolist(), strict=True))
        for name, p_value in tables.items():
            ever[name] += any(p_value(*count) <= 0.05 for count in counts)
    assert ever["anytime"] / len(first) <= 0.05
    assert ever["mcnemar"] / len(first) > 0.15


def test_models_are_compared_on_the_initial_states_that_both_met():
    bc = summarise("BC", [result(0, "100000"), result(1, "00")], anytime=True)
    ta = summarise("TA", [result(0, "1111"), result(1, "1111")], anytime=True)
    comparison = compare(bc, ta)
    assert (comparison.first_only, comparison.second_only, comparison.num_pairs) == (0, 5, 6)
    assert comparison.p_value == anytime_p_value(0, 5)
    assert "anytime-valid" in str(comparison)
    assert "exact" in str(compare(summarise("BC", [result(0, "10")]), summarise("TA", [result(0, "11")])))


def test_milestones_are_counted_in_the_tasks_order():
    reached = [{"lifted": 9}, {"lifted": 4, "inserted": 30}, {}]
    assert list(milestone_counts(reached, ("lifted", "inserted")).items()) == [("lifted", 2), ("inserted", 1)]
