"""The comparison as a table."""

from __future__ import annotations

from juicer.evaluation import ConditionResult, ModelResult
from juicer.reporting.comparison import markdown_table


def result(seed: int, successes: str) -> ModelResult:
    return ModelResult(seed, tuple(range(len(successes))), tuple(letter == "1" for letter in successes))


def test_table_states_interval_models_and_episodes():
    table = markdown_table([ConditionResult("bc", "BC", (result(0, "1110"), result(1, "1000")), (0.21, 0.79))])
    assert table.splitlines()[-1] == "| BC | 50% | 21% to 79% | 75% | 2 | 8 |"
