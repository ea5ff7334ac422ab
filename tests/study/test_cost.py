"""What was computed is told by condition and by stage."""

from __future__ import annotations

from juicer.study.cost import cost_section


def test_what_conditions_share_counts_once_by_stage_and_for_each_by_condition(made):
    shared = made.artifact("ingest", "episodes", config={"task": "one_leg"})
    for name in ("bc", "ta"):
        checkpoint = made.artifact("train", "checkpoint", inputs={"episodes": (shared,)}, config={"n": name})
        made.evaluation(name, checkpoint)
    section = cost_section([made.study])
    assert section is not None
    by_condition, by_stage = section.tables
    assert [row[:2] for row in by_condition.rows] == [("one_leg: BC", "1"), ("one_leg: TA", "1")]
    assert [row[:2] for row in by_stage.rows] == [("ingest", "1"), ("train", "2"), ("evaluate", "2"), ("together", "5")]
    costs = by_condition.rows
    made.evaluation("ta", checkpoint, shift="push")
    by_condition, by_stage = cost_section([made.study]).tables
    assert by_condition.rows == costs
    assert by_stage.rows[-1][1] == "6"
    assert {len(row) for row in by_stage.rows} == {len(by_stage.columns)}
    assert by_stage.columns[2] == by_condition.columns[2] == "CPU-hours"
