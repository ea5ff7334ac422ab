"""Tests between conditions allow for their number, and intervals for models as well as episodes."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from juicer.evaluation import ConditionResult, ModelResult, anytime_p_value, mcnemar_p_value, summarise
from juicer.seeding import stream
from juicer.study.statistics import (
    against,
    difference_interval,
    differences,
    holm,
    models_differ,
    points,
    state_p_value,
)

SIGNS = list(itertools.product((1, -1), repeat=5))


def test_holm_adjusts_as_in_its_definition():
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.9, 0.8]) == [1.0, 1.0]
    assert holm([]) == []


def test_holm_errs_once_in_twenty_however_many_tests_are_made(rng):
    errs = [min(holm(rng.random(10))) < 0.05 for _ in range(2000)]
    assert 0.035 < np.mean(errs) < 0.065


def test_every_pair_is_tested_once_and_the_second_is_measured_against_the_first(result):
    found = differences([result("bc", 0.4), result("ta", 0.8), result("ci", 0.5)])
    assert [(each.first.condition, each.second.condition) for each in found] == [
        ("bc", "ta"),
        ("bc", "ci"),
        ("ta", "ci"),
    ]
    assert [each.test.difference for each in found] == pytest.approx([0.4, 0.1, -0.3])
    assert [each.is_significant for each in found] == [True, False, True]
    assert all(low <= each.test.difference <= high for each in found for low, high in [each.interval])


@pytest.mark.parametrize(("lost", "gained"), [(0, 0), (0, 1), (3, 9), (20, 5), (0, 60)])
def test_of_one_model_each_the_test_of_states_is_mcnemars(lost, gained):
    states = [-1] * lost + [0] * 7 + [1] * gained
    assert state_p_value(states) == pytest.approx(mcnemar_p_value(lost, gained), abs=1e-12)
    assert state_p_value(states, anytime=True) == pytest.approx(anytime_p_value(lost, gained), rel=1e-2)


def test_signs_of_states_are_flipped_in_all_ways():
    states = [3, -1, 2, 0, 1]
    sums = [sum(sign * each for sign, each in zip(signs, states, strict=True)) for signs in SIGNS]
    assert state_p_value(states) == pytest.approx(np.mean([abs(each) >= sum(states) for each in sums]))


@pytest.mark.parametrize("anytime", [False, True])
def test_states_that_suit_one_condition_are_no_evidence_five_times(anytime):
    """Equal recipes, each of which does well from states of its own: its five models fail from the same states."""
    wrong = {"states": 0, "episodes": 0}
    for number in range(200):
        rng = stream(number, "states")
        pair = [
            ConditionResult(name, name, five_models(rng, rng.choice([0.35, 0.95], size=100)), (0.0, 1.0), anytime)
            for name in "ab"
        ]
        (found,) = differences(pair)
        wrong["states"] += found.is_significant
        p_of_episodes = (anytime_p_value if anytime else mcnemar_p_value)(found.test.first_only, found.test.second_only)
        wrong["episodes"] += p_of_episodes < 0.05
    assert wrong["states"] <= 17  # nineteen of twenty, and two standard deviations
    assert anytime or wrong["episodes"] > 30


def five_models(rng, chances):
    return tuple(ModelResult(seed, tuple(range(100)), tuple((rng.random(100) < chances).tolist())) for seed in range(5))


def test_what_no_training_changes_is_paired_with_every_model(result):
    replay, bc = result("replay", 0.5), result("bc", 0.8, 0.85, 0.9)
    (alone,), (found,) = differences([replay, bc]), differences([replay, bc], untrained={"replay"})
    assert (alone.num_models, alone.test.num_pairs, alone.is_clear) == (1, 100, False)
    assert (found.num_models, found.test.num_pairs, found.is_clear) == (3, 300, True)
    assert found.first is replay
    assert found.test.difference == pytest.approx(bc.average - replay.average)


def test_a_replay_is_known_by_what_it_was_made_of(made):
    made.evaluation("replay", made.artifact("memorise", "checkpoint"))
    made.evaluation("bc", made.artifact("train", "checkpoint"))
    assert made.study.untrained == {"replay"}


def test_no_difference_has_no_sign():
    assert [points(each) for each in (0.0, -0.004, 0.004, -0.02, 0.3)] == ["0", "0", "0", "-2", "+30"]


def test_fewer_tests_are_adjusted_less(result):
    bc, others = result("bc", 0.5), [result("ta", 0.66), result("ci", 0.5), result("x", 0.5)]
    (among_all, *_), (alone, *_) = differences([bc, *others]), against(bc, others)
    assert alone.test == among_all.test
    assert alone.p_adjusted < among_all.p_adjusted


def test_conditions_without_a_seed_in_common_are_not_paired(result):
    bc, ta = result("bc", 0.5), result("ta", 0.5)
    elsewhere = replace(ta, models=(replace(ta.models[0], seed=7),))
    assert differences([bc, elsewhere]) == []
    assert len(differences([bc, ta])) == 1


def test_interval_of_a_difference_covers_models_that_disagree(result):
    alike = difference_interval(result("bc", 0.5, 0.5, 0.5), result("ta", 0.7, 0.7, 0.7))
    apart = difference_interval(result("bc", 0.5, 0.5, 0.5), result("ta", 0.4, 0.7, 1.0))
    assert apart[1] - apart[0] > 1.5 * (alike[1] - alike[0])
    assert alike[0] > 0


def test_interval_of_a_difference_has_a_width_also_where_all_ended_alike(result):
    low, high = difference_interval(result("bc", 1.0, episodes=25), result("ta", 1.0, episodes=25))
    assert low < -0.05
    assert high > 0.05


@pytest.mark.parametrize("models", [2, 3, 5])
def test_equal_recipes_are_seldom_said_to_differ(result, models):
    clear = 0
    for number in range(100):
        rng = stream(number, "recipes")
        pair = [result(f"{name}{number}", *np.clip(rng.normal(0.7, 0.08, models), 0, 1)) for name in "ab"]
        clear += differences(pair)[0].is_clear
    assert clear <= 9


def test_interval_of_a_difference_holds_it_in_nineteen_of_twenty(result):
    covered = []
    for number in range(60):
        draws = stream(number, "coverage").random((2, 200))
        pair = [
            result(f"{name}{number}", float(np.mean(each < 0.6)), episodes=200)
            for name, each in zip("ab", draws, strict=True)
        ]
        low, high = difference_interval(*pair)
        covered.append(low <= 0 <= high)
    assert np.mean(covered) > 0.85


def test_interval_of_a_difference_holds_however_often_one_looks(monkeypatch):
    """Two recipes that succeed equally often, looked at in eight blocks until their interval says that they differ."""
    monkeypatch.setattr("juicer.study.statistics.DRAWS", 500)
    wrong = {False: 0, True: 0}
    for number, anytime in itertools.product(range(100), wrong):
        draws = stream(number, "looks").random((2, 5, 200)) < 0.7
        for episodes in range(25, 201, 25):
            first, second = (
                [
                    ModelResult(seed, tuple(range(episodes)), tuple(each[:episodes].tolist()))
                    for seed, each in enumerate(models)
                ]
                for models in draws
            )
            pair = [ConditionResult("", "", tuple(models), (0.0, 1.0), anytime) for models in (first, second)]
            low, high = difference_interval(*pair)
            if not low <= 0 <= high:
                wrong[anytime] += 1
                break
    assert wrong[True] <= 5 < wrong[False]


def test_episodes_that_only_one_of_two_conditions_has_are_not_compared(result):
    bc, ta = result("bc", 0.4, 0.5), result("ta", 0.7, 0.8)
    shorter = tuple(replace(m, initial_states=m.initial_states[:60], successes=m.successes[:60]) for m in bc.models)
    (found,) = differences([replace(bc, models=shorter), ta])
    assert found.test.num_pairs == 120
    low, high = found.interval
    assert low < found.test.difference < high


def test_models_that_differ_by_chance_are_not_said_to_differ(result):
    assert models_differ(result("bc", 0.5, 0.55, 0.48)) > 0.05
    assert models_differ(result("bc", 0.2, 0.5, 0.8)) < 0.001
    assert models_differ(result("bc", 1.0, 1.0, 1.0)) == 1.0
    assert models_differ(result("bc", 0.5)) == 1.0


def test_models_that_differ_are_found_where_states_are_of_unequal_difficulty():
    """All models fail where it is hard; episodes taken for independent would hide what is left."""
    states = tuple(range(100))
    models = [
        ModelResult(seed, states, tuple(state < 40 + better for state in states))
        for seed, better in enumerate((0, 4, 14))
    ]
    assert models_differ(summarise("bc", models)) < 0.001
    # A statistic by hand (Cochran 1950): columns 3 and 1 of 4, rows 2, 1, 1, 0: (2 - 1) (2 * 10 - 16) / (2 * 4 - 6).
    pair = [
        ModelResult(0, (0, 1, 2, 3), (True, True, True, False)),
        ModelResult(1, (0, 1, 2, 3), (True,) + (False,) * 3),
    ]
    assert models_differ(summarise("bc", pair)) == pytest.approx(chi2.sf(2.0, 1))
