"""Rates of rounds are told with what is missing behind them."""

from __future__ import annotations

import pytest

from juicer.study.rounds import rounds_section


@pytest.fixture
def collected(made):
    """Evaluate a model that grew out of rollouts: successes of twenty by the place of their first initial state."""

    def collect(seed: int, **successes: int) -> None:
        rollouts = tuple(
            made.artifact(
                "collect",
                "episodes",
                config={"task": "one_leg", "first": int(first.removeprefix("at_")), "seed": seed},
                summary={"successes": won, "episodes": 20},
            )
            for first, won in successes.items()
        )
        checkpoint = made.artifact("train", "checkpoint", inputs={"episodes": rollouts}, config={"seed": seed})
        made.evaluation("ta_ci", checkpoint, seed=seed)

    return collect


def test_a_model_that_is_missing_in_a_round_is_told_and_its_next_round_stays_the_next(made, collected):
    collected(0, at_0=10, at_200=20)
    # It had no success in the first round, so nothing grew out of that.
    collected(1, at_200=10)
    section = rounds_section([made.study])
    assert section is not None
    (table,) = section.tables
    assert table.columns == ("condition", "round 1", "round 2", "evaluated")
    ((title, first, second, evaluated),) = table.rows
    assert title == "TA_CI"
    assert first.startswith("50% (")
    assert first.endswith("), 1 of 2 models")
    assert second.startswith("75% (")
    assert second.endswith(")")
    assert evaluated == "50%"


def test_conditions_without_rounds_have_no_such_section(made):
    made.evaluation("bc", made.artifact("train", "checkpoint"))
    assert rounds_section([made.study]) is None
