"""A human's minutes are counted one way wherever they are told."""

from __future__ import annotations

import shutil

import pytest

from juicer.study.effort import effort_section


def demonstrated(made, **facts):
    summary = {"episodes": 2, "steps": 1200, "idle_steps_dropped": 300} | facts
    return made.artifact("ingest", "episodes", summary=summary, config={"task": "one_leg"}, files={"a": "1", "b": "2"})


@pytest.mark.parametrize(
    ("facts", "minutes"),
    [
        # With the recordings that were rejected.
        ({"operator_minutes": 4.0}, "4.0"),
        # An earlier juicer's demonstrations do not tell.
        ({}, "2.5"),
    ],
)
def test_minutes_of_demonstrations_are_the_same_in_both_tables(made, facts, minutes):
    checkpoint = made.artifact("train", "checkpoint", inputs={"episodes": (demonstrated(made, **facts),)})
    made.evaluation("bc", checkpoint)
    section = effort_section([made.study])
    assert section is not None
    demonstrations, by_condition = section.tables
    assert demonstrations.rows[0][demonstrations.columns.index("minutes")] == minutes
    assert by_condition.rows[0][:2] == ("BC", minutes)


def test_labels_and_corrections_count_and_success_is_divided_by_all(made):
    logs = demonstrated(made, operator_minutes=4.0)
    labels = made.artifact(
        "annotate", "annotations", inputs={"episodes": (logs,)}, summary={"critical_states": 5, "authors": ["ann"]}
    )
    corrections = made.artifact("correct", "episodes", summary={"human_steps": 3000})
    learned = {"episodes": (logs, corrections), "annotations": (labels,)}
    made.evaluation("dagger", made.artifact("train", "checkpoint", inputs=learned))
    section = effort_section([made.study])
    assert section is not None
    assert section.tables[1].rows == (("DAGGER", "4.0", "1.0", "5.0", "10.0", "5.0"),)
    assert "Corrections of a round in which none succeeded are not counted" in section.note


def test_minutes_of_several_tasks_are_not_set_against_success_at_one(made):
    summary = {"episodes": 1, "steps": 1200, "idle_steps_dropped": 0, "operator_minutes": 4.0}
    data = tuple(
        made.artifact("ingest", "episodes", config={"task": task}, summary=summary) for task in ("one_leg", "lamp")
    )
    made.evaluation("multitask", made.artifact("train", "checkpoint", inputs={"episodes": data}))
    (row,) = effort_section([made.study]).tables[1].rows
    assert row[0] == "MULTITASK (2 tasks)"
    assert row[-2:] == ("8.0", "-")


def test_labels_cost_what_the_papers_annotators_needed_on_that_task(made):
    logs = made.artifact(
        "ingest",
        "episodes",
        summary={"episodes": 50, "steps": 1200, "idle_steps_dropped": 0, "operator_minutes": 4.0},
        config={"task": "lamp"},
        files={"a": "1"},
    )
    summary = {"critical_states": 250, "authors": ["ann"]}
    labels = made.artifact("annotate", "annotations", inputs={"episodes": (logs,)}, summary=summary)
    own = demonstrated(made, operator_minutes=4.0)
    made.evaluation("multitask", made.artifact("train", "checkpoint", inputs={"data": (own, logs, labels)}))
    section = effort_section([made.study])
    assert section is not None
    assert section.tables[-1].rows[0][2] == "30.0", "the paper's minutes for fifty lamps"


def test_policies_that_were_shown_nothing_have_no_such_section(made):
    made.evaluation("elsewhere", made.artifact("train", "checkpoint"))
    assert effort_section([made.study]) is None


def test_what_the_page_measured_stands_beside_the_papers_minutes(made):
    logs = demonstrated(made, operator_minutes=4.0)
    people = {
        "demonstrations": 2,
        "judged": 2,
        "annotators": 2,
        "minutes": 0.5,
        "seconds": 15.0,
        "keys": 1.5,
        "agreement": 0.5,
    }
    summary = {"critical_states": 2, "authors": {"human": 2}, "people": people | {"disputed": 0}}
    labels = made.artifact("annotate", "annotations", inputs={"episodes": (logs,)}, summary=summary)
    made.evaluation("ta", made.artifact("train", "checkpoint", inputs={"annotations": (labels,)}))
    section = effort_section([made.study])
    assert section is not None
    _, measured, by_condition = section.tables
    assert measured.rows == (("one_leg", "2", "2", "0.5", "12.5", "15.0", "1.50", "50%", "-", "0", "10"),)
    assert by_condition.rows[0][2] == "0.5"


@pytest.mark.parametrize(("minutes", "elsewhere", "shown"), [(5.0, 25, "10.0"), (0.0, 50, "10.0")])
def test_labels_that_people_brought_from_elsewhere_cost_what_the_papers_did(made, minutes, elsewhere, shown):
    logs = demonstrated(made, operator_minutes=4.0)
    people = {"demonstrations": 50, "judged": 50 - elsewhere, "minutes": minutes, "elsewhere": elsewhere}
    summary = {"critical_states": 50, "authors": {"human": 50}, "people": people}
    labels = made.artifact("annotate", "annotations", inputs={"episodes": (logs,)}, summary=summary)
    made.evaluation("ta", made.artifact("train", "checkpoint", inputs={"annotations": (labels,)}))
    section = effort_section([made.study])
    assert section is not None
    assert section.tables[-1].rows[0][2] == shown
    assert len(section.tables) == (3 if minutes else 2), "what the page measured is told if it measured anything"


def test_what_is_proposed_beside_the_labels_of_a_file_cost_nobody_a_minute(made):
    logs = demonstrated(made, operator_minutes=4.0)
    for condition, facts in (("ta", {"files": {"labels.csv": "1"}}), ("proposed", {})):
        summary = {"critical_states": 50, "authors": {"human": 5, "proposed": 45} if facts else {"proposed": 50}}
        labels = made.artifact("annotate", "annotations", inputs={"episodes": (logs,)}, summary=summary, **facts)
        made.evaluation(condition, made.artifact("train", "checkpoint", inputs={"annotations": (labels,)}))
    section = effort_section([made.study])
    assert section is not None
    # Where nobody labels, what is told is what people would need.
    assert {row[0]: row[2] for row in section.tables[-1].rows} == {"TA": "1.0", "PROPOSED": "10.0"}


def test_pages_say_of_which_randomness_and_temperament_recordings_are(made):
    for condition, config in (
        ("bc", {"randomness": "low"}),
        ("hurried", {"randomness": "med", "temperament": {"kind": "human"}}),
    ):
        summary = {"device": "scripted operator", "logs": 2}
        logs = made.artifact("record", "logs", summary=summary, config={"task": "one_leg"} | config)
        summary = {"episodes": 2, "steps": 1200, "idle_steps_dropped": 0}
        episodes = made.artifact(
            "ingest", "episodes", summary=summary, config={"task": "one_leg"}, inputs={"logs": (logs,)}
        )
        made.evaluation(condition, made.artifact("train", "checkpoint", inputs={"episodes": (episodes,)}))
    section = effort_section([made.study])
    assert section is not None
    rows = [(row[1], row[4]) for row in section.tables[0].rows]
    assert rows == [("low", "scripted operator"), ("med", "scripted operator, human-like")]
    assert made.study.base == "2 demonstrations, recorded by a scripted operator or a scripted operator, human-like"


def test_of_recordings_that_were_removed_nothing_is_said_rather_than_that_people_made_them(made):
    summary = {"device": "scripted operator", "logs": 2}
    logs = made.artifact("record", "logs", summary=summary, config={"task": "one_leg", "randomness": "low"})
    summary = {"episodes": 2, "steps": 1200, "idle_steps_dropped": 0}
    inputs = {"logs": (logs,)}
    episodes = made.artifact("ingest", "episodes", summary=summary, config={"task": "one_leg"}, inputs=inputs)
    made.evaluation("bc", made.artifact("train", "checkpoint", inputs={"episodes": (episodes,)}))
    shutil.rmtree(made.store.cache / str(logs))
    section = effort_section([made.study])
    assert section is not None
    assert section.tables[0].rows[0][:5] == ("one_leg", "-", "2", "-", "-")
