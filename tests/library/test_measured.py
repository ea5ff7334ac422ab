"""Two evaluations are compared state by state, or not at all."""

from __future__ import annotations

from dataclasses import replace

import pytest

from juicer.episode import Outcome
from juicer.errors import ConfigError
from juicer.evaluation import mcnemar_p_value
from juicer.library.measured import Evaluation, compare
from juicer.storage.evaluations import EvaluationRow


def evaluation(successes: str, first: int = 0) -> Evaluation:
    """From a string of ``1`` for success and ``0`` for failure."""
    outcomes = [Outcome.SUCCESS if letter == "1" else Outcome.TIMEOUT for letter in successes]
    rows = tuple(EvaluationRow(place, first + place, outcome, 0, 9) for place, outcome in enumerate(outcomes))
    return Evaluation(f"policy {successes}", "one_leg", "low", None, rows)


def test_only_initial_states_that_both_started_from_are_compared():
    found = compare(evaluation("11110"), evaluation("0010", first=1))
    assert (found.first_only, found.second_only, found.num_pairs) == (2, 0, 4)
    assert found.p_value == mcnemar_p_value(2, 0) == 0.5
    assert str(found) == (
        "policy 11110 alone succeeded from 2 of 4 initial states, policy 0010 alone from 0: "
        "p = 0.5 (McNemar's exact test)"
    )


def test_a_rate_and_a_comparison_say_what_policies_saw():
    ours, theirs = evaluation("10"), replace(evaluation("11"), observes="images, poses in training")
    assert str(theirs).endswith("(95 % interval 34.2% to 100.0%), from images, poses in training")
    assert str(compare(replace(ours, observes="state"), theirs)).startswith(
        "policy 10 (state) alone succeeded from 0 of 2 initial states, policy 11 (images, poses in training) alone from"
    )
    assert "policy 10 (what it saw is not known) alone" in str(compare(ours, theirs))
    assert "images" not in str(compare(theirs, theirs))


def test_a_limit_of_steps_is_compared_with_that_of_the_task():
    ours = evaluation("10")
    assert compare(ours, replace(ours, max_steps=1000)).p_value == 1
    with pytest.raises(ConfigError, match="max_steps of 60 and 1000 cannot be compared"):
        compare(ours, replace(ours, max_steps=60))


def test_what_cannot_be_compared_is_refused():
    ours = evaluation("10")
    for other, problem in (
        (replace(ours, task="lamp"), "of one task can be compared, got 'one_leg' and 'lamp'"),
        (replace(ours, randomness="med"), "of one randomness"),
        (evaluation("10", first=5), "different initial states"),
        (0.5, "not a float"),
    ):
        with pytest.raises(ConfigError, match=problem):
            compare(ours, other)


def test_the_table_has_a_row_an_episode():
    rows = (
        EvaluationRow(0, 7, Outcome.SUCCESS, 1, 9, {"placed": 2, "done": 8}),
        EvaluationRow(1, 8, Outcome.PART_LOST, 0, 5),
    )
    table = Evaluation("ours", "one_leg", "low", None, rows).table
    assert [*table["success"]] == [True, False]
    assert [*table["outcome"]] == ["success", "part_lost"]
    assert [*table.columns[-2:]] == ["placed", "done"]
    assert table["done"].isna().tolist() == [False, True]
