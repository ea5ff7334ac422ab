"""The comparison as a table."""

from __future__ import annotations

from juicer.evaluation import ConditionResult, ModelResult
from juicer.reporting.comparison import markdown_table, robustness_table


def result(seed: int, successes: str) -> ModelResult:
    return ModelResult(seed, tuple(range(len(successes))), tuple(letter == "1" for letter in successes))


def test_table_states_interval_models_and_episodes():
    table = markdown_table([ConditionResult("bc", "BC", (result(0, "1110"), result(1, "1000")), (0.21, 0.79))])
    assert table.splitlines()[-1] == "| BC | 50% | 21% to 79% | 75% | 2 | 8 |"


def test_rates_under_shifts_stand_beside_the_usual_ones():
    def row(name: str, usual: str, pushed: str) -> ConditionResult:
        under = ConditionResult(name, name.upper(), (result(0, pushed),), (0.1, 0.6))
        return ConditionResult(
            name, name.upper(), (result(0, usual),), (0.2, 0.8), shifted={"push": under, "light": None}
        )

    results = [row("bc", "1110", "1000"), row("ta", "1111", "1110")]
    columns, rows = robustness_table(results)
    assert columns == ["condition", "no shift", "push", "light"]
    assert rows[0] == ["BC", "75% (20 to 80%)", "25% (10 to 60%)", "sees no images"]
    assert markdown_table(results).splitlines()[-1].startswith("| TA | 100% (20 to 80%) | 75% (10 to 60%) |")


def test_without_shifts_there_is_no_such_table():
    results = [ConditionResult("bc", "BC", (result(0, "1110"),), (0.21, 0.79))]
    assert robustness_table(results) == ([], [])


def test_policies_that_see_stand_in_a_table_of_their_own():
    told = ConditionResult("bc", "BC", (result(0, "1110"),), (0.21, 0.79), observes="state")
    seeing = ConditionResult("eyes", "Eyes (images)", (result(0, "1000"),), (0.05, 0.7), observes="images")
    first, second = markdown_table([told, seeing]).split("\n\n")
    assert "BC" in first
    assert "Eyes" not in first
    assert "| Eyes (images) | 25% |" in second
