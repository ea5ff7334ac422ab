"""Sections on how often policies succeed, beside the paper's figures, and on which differences are more than chance."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from juicer.evaluation import ConditionResult
from juicer.reporting.comparison import by_observation
from juicer.reporting.paper import paper_figures
from juicer.reporting.section import Section, Table
from juicer.study.material import Measured, TaskStudy
from juicer.study.statistics import Difference, differences, p_text, points

REFERENCE = "bc"
"""What others are compared with, where it is among them; else the first of them."""


def success_section(studies: Sequence[TaskStudy]) -> Section | None:
    """Rates of every condition beside the paper's, in the form of its Table VI."""
    tables = tuple(table for study in studies for table in _rates(study))
    if not tables:
        return None
    return Section(
        "rates",
        "Success",
        "How often each policy succeeds",
        "Averages over models, with 95 % intervals over models and episodes, of one model over its episodes alone; "
        "best is the best single model. Models of the same randomness start from the same initial states, which no "
        "training or collection has seen. The paper's figures (Tables VI and VII, average and best of five) are of "
        "another simulator, from images, with 50 demonstrations at low randomness.",
        (*_overview(studies), *tables),
    )


def differences_section(studies: Sequence[TaskStudy]) -> Section | None:
    """Paired tests between all conditions that differ in their method alone."""
    tables = []
    for study in studies:
        for setting, group in study.groups.items():
            results = [each.result for each in group]
            if found := differences(results):
                tables += list(paired_tests(f"{study.task}{under(setting)}", results, found))
    if not tables:
        return None
    return Section(
        "differences",
        "Differences",
        "Which differences are more than chance",
        "Models are paired by their seeds, episodes by their initial states. Intervals of differences are over models "
        "and episodes. p is of a paired test, two-sided, adjusted for all pairs of a task's conditions that are "
        "tested together (Holm). The test speaks of these models: where there is one of each, other trainings of a "
        "recipe may differ by more.",
        tuple(tables),
    )


def percent(rate: float) -> str:
    """E.g. ``74%``."""
    return f"{rate:.0%}"


def interval_text(interval: tuple[float, float]) -> str:
    """E.g. ``67% to 80%``."""
    return f"{percent(interval[0])} to {percent(interval[1])}"


def _rates(study: TaskStudy) -> Iterator[Table]:
    drawn = {name for curve in study.curves for name in curve.points}
    columns = ("condition", "average", "95% interval", "best", "models", "episodes", "paper, average / best")
    for setting, group in study.groups.items():
        # A point of a curve that stands alone is told there.
        if len(group) == 1 and group[0].result.condition in drawn:
            continue
        for seen, results in by_observation([each.result for each in group]).items():
            rows = tuple(_row(study.task, study.measured[result.condition]) for result in results)
            changed = group[0].setting
            note = changed.spelled_out if changed else study.base
            yield Table(columns, rows, f"{study.task}{under(seen)}{under(setting)}", note)


def _row(task: str, measured: Measured) -> tuple[str, ...]:
    result = measured.result
    return (
        result.title,
        percent(result.average),
        interval_text(result.interval),
        percent(result.best),
        str(result.num_models),
        str(result.num_episodes),
        "-" if measured.setting else _of_paper(task, result.condition),
    )


def _of_paper(task: str, condition: str) -> str:
    return " / ".join(map(percent, paper_figures(task).get(condition, ()))) or "-"


def _overview(studies: Sequence[TaskStudy]) -> Iterator[Table]:
    """One line a condition, one column a task, as in the paper."""
    if len(studies) < 2:
        return
    plain = [each.result for study in studies for each in study.measured.values() if not each.setting]
    for seen, results in by_observation(plain).items():
        names = dict.fromkeys(result.condition for result in results)
        yield _all_tasks(studies, tuple(names), under(seen))


def _all_tasks(studies: Sequence[TaskStudy], names: Sequence[str], seen: str) -> Table:
    rows = []
    for name in names:
        found = [study.measured.get(name) for study in studies]
        title = next(each.result.title for each in found if each)
        cells = (
            f"{percent(each.result.average)} / {percent(each.result.best)} "
            f"({_of_paper(study.task, name).replace(' ', '')})"
            if each
            else "-"
            for study, each in zip(studies, found, strict=True)
        )
        rows.append((title, *cells))
    return Table(
        ("condition", *(study.task for study in studies)),
        tuple(rows),
        f"All tasks{seen}: average / best, in brackets the paper's",
    )


def under(setting: str) -> str:
    """What a group of conditions changes, as the end of a heading."""
    return f", {setting}" if setting else ""


def paired_tests(title: str, results: Sequence[ConditionResult], found: Sequence[Difference]) -> Iterator[Table]:
    """The reference with every other condition; and if there are several, all pairs."""
    reference = next((result for result in results if result.condition == REFERENCE), results[0])
    rows = [_tested(each, reference) for each in found if reference in (each.first, each.second)]
    columns = ("conditions", "difference", "95% interval", "only first / only second", "p, adjusted")
    yield Table(columns, tuple(rows), title, f"p is of {found[0].test.test}.")
    if len(results) > 2:
        cells = {(each.first.condition, each.second.condition): each for each in found}
        yield Table(
            ("", *(result.title for result in results)),
            tuple((row.title, *(_cell(row, column, cells) for column in results)) for row in results),
            f"{title}: each row's rate minus each column's, in points, over the models and episodes that both have",
            "With a star where p, adjusted, is below 0.05.",
        )


def _tested(each: Difference, reference: ConditionResult) -> tuple[str, ...]:
    is_turned = each.second == reference
    first, second = (each.second, each.first) if is_turned else (each.first, each.second)
    low, high = (-each.interval[1], -each.interval[0]) if is_turned else each.interval
    test = each.test
    alone = (test.second_only, test.first_only) if is_turned else (test.first_only, test.second_only)
    return (
        f"{first.title} → {second.title}",
        f"{points(-test.difference if is_turned else test.difference)} points",
        f"{points(low)} to {points(high)}",
        f"{alone[0]} / {alone[1]} of {test.num_pairs}",
        p_text(each.p_adjusted).removeprefix("= "),
    )


def _cell(row: ConditionResult, column: ConditionResult, found: dict[tuple[str, str], Difference]) -> str:
    for names, sign in (((column.condition, row.condition), 1), ((row.condition, column.condition), -1)):
        if each := found.get(names):
            return f"{points(sign * each.test.difference)}{'*' if each.is_significant else ''}"
    return "-" if row == column else "?"
