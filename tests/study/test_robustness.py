"""What is told of scenes unlike those of training."""

from __future__ import annotations

from dataclasses import replace

from juicer.study.robustness import robustness_section


def test_rates_and_tests_under_a_shift_stand_together(result, study):
    bc, ta = (
        replace(result(name, usual), shifted={"push": result(name, pushed), "light": None})
        for name, usual, pushed in (("bc", 0.8, 0.2), ("ta", 0.9, 0.9))
    )
    rates, tests = robustness_section([study(bc, ta)]).tables
    assert rates.columns == ("condition", "no shift", "push", "light")
    assert [row[0] for row in rates.rows] == ["BC", "TA"]
    assert {row[3] for row in rates.rows} == {"sees no images"}
    assert tests.title == "one_leg, under push"
    assert tests.rows[0][:2] == ("BC → TA", "+70 points")


def test_a_shift_of_fewer_models_says_so(result, study):
    bc = replace(result("bc", 0.8, 0.9, 0.7), shifted={"push": result("bc", 0.2, 0.4)})
    (rates,) = robustness_section([study(bc)]).tables
    assert rates.rows[0][1].startswith("80% (")
    assert rates.rows[0][2].startswith("30% (")
    assert [cell.endswith(", 2 of 3 models") for cell in rates.rows[0][1:]] == [False, True]


def test_who_sees_images_is_tested_with_others_that_do(result, study):
    usual, images = (("bc", 0.2), ("ta", 0.9)), (("eyes", 0.5), ("lens", 0.6))
    results = [
        replace(result(name, 0.8), shifted={"push": result(name, pushed)}, observes=observes)
        for observes, pairs in (("", usual), ("images", images))
        for name, pushed in pairs
    ]
    _, told, _, seeing = robustness_section([study(*results)]).tables
    assert (told.title, [row[0] for row in told.rows]) == ("one_leg, under push", ["BC → TA"])
    assert (seeing.title, [row[0] for row in seeing.rows]) == ("one_leg, images, under push", ["EYES → LENS"])


def test_where_nothing_was_measured_under_a_shift_there_is_no_such_section(result, study):
    bc, ta = result("bc", 0.8), result("ta", 0.9)
    assert robustness_section([study(bc, ta)]) is None
    assert robustness_section([study(replace(bc, shifted={"light": None}), ta)]) is None
