"""Rates of rounds are told with what is missing behind them."""

from __future__ import annotations

import pytest

from flows.loop_config import LoopConfig
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


def test_rounds_of_seeds_that_start_elsewhere_are_the_same_rounds(made, collected):
    loop = LoopConfig()
    for seed, won in ((0, (10, 20)), (1, (14, 16)), (2, (12,))):
        firsts = [loop.collection(seed, turn).first for turn in range(1, len(won) + 1)]
        collected(seed, **{f"at_{first}": each for first, each in zip(firsts, won, strict=True)})
    section = rounds_section([made.study])
    assert section is not None
    (table,) = section.tables
    assert table.columns == ("condition", "round 1", "round 2", "evaluated")
    ((title, first, second, evaluated),) = table.rows
    assert title == "TA_CI"
    assert first.startswith("60% (")
    assert first.endswith(")")
    # Nothing was learned from the third's second round.
    assert second.startswith("90% (")
    assert second.endswith("), 2 of 3 models")
    assert evaluated == "50%"


def test_one_policy_for_several_tasks_has_no_rounds(made):
    data = []
    for task in ("one_leg", "lamp"):
        demonstrations = made.artifact("ingest", "episodes", config={"task": task})
        collector = made.artifact("train", "checkpoint", inputs={"episodes": (demonstrations,)})
        data.append(
            made.artifact(
                "collect",
                "episodes",
                inputs={"checkpoint": (collector,)},
                config={"task": task, "first": 0},
                summary={"successes": 9, "episodes": 10},
            )
        )
    made.evaluation("multitask", made.artifact("train", "checkpoint", inputs={"episodes": tuple(data)}))
    assert rounds_section([made.study]) is None


def test_conditions_without_rounds_have_no_such_section(made):
    made.evaluation("bc", made.artifact("train", "checkpoint"))
    assert rounds_section([made.study]) is None
