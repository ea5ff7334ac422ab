"""A study as a page of Markdown."""

from __future__ import annotations

from dataclasses import replace

import pytest

from juicer.reporting.section import Chart, Section, Table
from juicer.study.curves import Curve
from juicer.study.markdown import write_markdown
from juicer.study.sections import sections
from juicer.study.success import differences_section, success_section


def test_a_page_holds_its_tables_and_its_drawings_lie_beside_it(tmp_path):
    chart = Chart("curve", "A curve", "<svg>", b"\x89PNG", "Dots.")
    section = Section(
        "curves", "Curves", "Curves", "How.", (Table(("x", "rate"), (("1", "50%"),), "T", "Note."),), (chart,)
    )
    files = write_markdown(tmp_path / "study.md", "my study", {"made on": "today"}, [section])
    assert files == [tmp_path / "study.md", tmp_path / "study" / "curve.png"]
    text = files[0].read_text()
    assert "# my study\n" in text
    assert "| made on | today |" in text
    assert "| x | rate |\n| --- | ---: |\n| 1 | 50% |" in text
    assert "![A curve](study/curve.png)" in text
    write_markdown(tmp_path / "my study (2).md", "my study", {}, [section])
    assert "![A curve](my%20study%20%282%29/curve.png)" in (tmp_path / "my study (2).md").read_text()


def test_what_names_say_stays_text(tmp_path):
    table = Table(("a",), (("<b>x</b> | `y` *z*\n[w](v)\x1b[2J",),))
    (path,) = write_markdown(tmp_path / "study.md", "s", {}, [Section("a", "A", "A", "", (table,))])
    assert "| \\<b>x\\</b> \\| \\`y\\` \\*z\\*\\n\\[w](v)" in path.read_text().replace("\\\\n", "\\n")
    assert "\x1b" not in path.read_text()


def test_conditions_that_change_alike_are_tested_with_each_other_only(study, result):
    tried = study(
        result("bc", 0.4), result("ta", 0.8), result("ten_bc", 0.1), result("ten_ta", 0.5), result("alone", 0.3),
        settings={"ten_bc": "randomness med", "ten_ta": "randomness med", "alone": "rounds 2"},
    )  # fmt: skip
    rates, tests = sections([tried], (success_section, differences_section))
    titles = ["one_leg", "one_leg, randomness med", "one_leg, rounds 2"]
    assert [table.title for table in rates.tables] == titles
    for points, told in (({"bc": 1, "alone": 2}, titles[:2]), ({"alone": 2, "not_yet": 3}, titles)):
        curve = Curve(name="rounds", title="R", axis="r", fit="none", points=points)
        (rates,) = sections([replace(tried, curves=(curve,))], (success_section,))
        assert [table.title for table in rates.tables] == told, "with the curve, if there is one"
    assert [[row[0] for row in table.rows] for table in tests.tables] == [["BC → TA"], ["TEN_BC → TEN_TA"]]
    assert tests.tables[0].rows[0][1] == "+40 points"


@pytest.mark.parametrize(("models", "mark"), [(1, "°"), (3, "*")])
def test_all_pairs_are_shown_at_once_with_a_star_where_they_clearly_differ(study, result, models, mark):
    results = [result(name, *[rate] * models) for name, rate in (("bc", 0.4), ("ta", 0.8), ("ci", 0.42))]
    section = differences_section([study(*results)])
    assert section is not None
    _, matrix = section.tables
    assert matrix.columns == ("", "BC", "TA", "CI")
    assert matrix.rows == (
        ("BC", "-", f"-40{mark}", "-2"),
        ("TA", f"+40{mark}", "-", f"+38{mark}"),
        ("CI", "+2", f"-38{mark}", "-"),
    )


def test_tasks_stand_side_by_side_as_in_the_paper(study, result):
    one_leg = study(result("bc", 0.4, 0.6), result("ta", 0.8))
    section = success_section([one_leg, replace(study(result("bc", 0.1)), task="lamp")])
    assert section is not None
    overview = section.tables[0]
    assert overview.columns == ("condition", "one_leg", "lamp")
    assert overview.rows == (
        ("BC", "50% / 60% of 2 (59%/68%)", "10% of 1 (6%/7%)"),
        ("TA", "80% of 1 (64%/65%)", "-"),
    )


def test_tasks_stand_side_by_side_where_they_saw_the_same_under_the_settings_of_the_study(study, result):
    seen, told, med = (result("bc", rate) for rate in (0.4, 0.1, 0.9))
    seen = replace(seen, observes="images", title="BC (images)")
    ta = result("ta", 0.8)
    one_leg = study(seen, ta)
    lamp = replace(study(told), task="lamp")
    square_table = replace(study(med, settings={"bc": "randomness med"}), task="square_table")
    images, states = success_section([one_leg, lamp, square_table]).tables[:2]
    assert images.rows == (("BC (images)", "40% of 1 (59%/68%)", "-", "-"),)
    assert [row[0] for row in states.rows] == ["TA", "BC"]
    assert states.rows[1][1:] == ("-", "10% of 1 (6%/7%)", "-")


def test_state_and_image_results_share_no_table(study, result):
    seeing = replace(result("eyes", 0.5, 0.6), observes="images; poses in training")
    mixed = study(
        replace(result("bc", 0.7, 0.8), observes="state"), replace(result("ta", 0.9), observes="state"), seeing
    )
    tables = success_section([mixed, replace(mixed, task="lamp")]).tables
    for table in tables:
        assert len({row[0] == "EYES" for row in table.rows}) == 1
    (tested,) = differences_section([mixed]).tables
    assert [row[0] for row in tested.rows] == ["BC → TA"]
    assert {"one_leg", "one_leg, images; poses in training"} <= {table.title for table in tables}
