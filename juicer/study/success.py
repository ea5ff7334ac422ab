"""Sections on how often policies succeed, beside the paper's figures, and on which differences are more than chance."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import chain

from juicer.evaluation import ConditionResult
from juicer.reporting.comparison import best_of, by_observation
from juicer.reporting.paper import paper_figures
from juicer.reporting.section import Section, Table
from juicer.study.material import Measured, TaskStudy, under
from juicer.study.points import can_be_drawn, curve_points
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
        "Policies are told the poses of all parts, as only a simulator can, unless a heading says what they see. "
        "Averages over models, with 95 % intervals over models and episodes, of one model over its episodes alone; "
        "best is the best of several models. All models of a condition learned from the same demonstrations and "
        "snippets, and differ by their training and by the rollouts that they collected. Models of the same randomness "
        "start from the same initial states, which no training or collection has seen. The paper's "
        "figures (Tables VI and VII, average and best of five) are of another simulator, from images, with 50 "
        "demonstrations at low randomness.",
        (*_overview(studies), *tables),
    )


def differences_section(studies: Sequence[TaskStudy]) -> Section | None:
    """Paired tests between all conditions that differ in their method alone, and whose policies see the same."""
    tables = []
    for study in studies:
        for alike, results in study.tested_together:
            if found := differences(results, study.untrained):
                tables += list(paired_tests(f"{study.task}{alike}", results, found))
    if not tables:
        return None
    return Section(
        "differences",
        "Differences",
        "Which differences are more than chance",
        "Models are paired by their seeds, a replay with every model, and episodes by their initial states. Intervals "
        "of differences are over models and initial states. p is of a paired test over initial states, two-sided, "
        "adjusted for all pairs of a task's conditions that are tested together (Holm). The test speaks of these "
        "models: where there is one of each, other trainings of a recipe may differ by more.",
        tuple(tables),
    )


def percent(rate: float) -> str:
    """E.g. ``74%``."""
    return f"{rate:.0%}"


def interval_text(interval: tuple[float, float]) -> str:
    """E.g. ``67% to 80%``."""
    return f"{percent(interval[0])} to {percent(interval[1])}"


def _rates(study: TaskStudy) -> Iterator[Table]:
    curves = (curve_points(study, curve) for curve in study.curves)
    drawn = {result.condition for found in curves if can_be_drawn(found) for _, result in found}
    columns = ("condition", "average", "95% interval", "best", "models", "episodes", "paper, average / best")
    for setting, group in study.groups.items():
        # A condition with a setting of its own that is a point of a curve is told there.
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
        best_of(result),
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
    columns = ("condition", *(study.task for study in studies))
    plain = [[each.result for each in study.measured.values() if not each.setting] for study in studies]
    grouped = [by_observation(results) for results in plain]
    for seen in dict.fromkeys(name for groups in grouped for name in groups):
        of_task = {
            study.task: {result.condition: result for result in groups.get(seen, ())}
            for study, groups in zip(studies, grouped, strict=True)
        }
        rows = tuple(_in_all_tasks(of_task, name) for name in dict.fromkeys(chain.from_iterable(of_task.values())))
        yield Table(columns, rows, f"All tasks{under(seen)}: average / best of how many, in brackets the paper's")


def _in_all_tasks(of_task: Mapping[str, Mapping[str, ConditionResult]], name: str) -> tuple[str, ...]:
    title = next(results[name].title for results in of_task.values() if name in results)
    return title, *(_average_and_best(task, results.get(name)) for task, results in of_task.items())


def _average_and_best(task: str, result: ConditionResult | None) -> str:
    if result is None:
        return "-"
    paper = _of_paper(task, result.condition).replace(" ", "")
    best = f" / {best_of(result)}" if result.num_models > 1 else ""
    return f"{percent(result.average)}{best} of {result.num_models} ({paper})"


def paired_tests(title: str, results: Sequence[ConditionResult], found: Sequence[Difference]) -> Iterator[Table]:
    """The reference with every other condition; and if there are several, all pairs."""
    paired = [result for result in results if any(result in (each.first, each.second) for each in found)]
    reference = next((result for result in paired if result.condition == REFERENCE), paired[0])
    rows = [_tested(each, reference) for each in found if reference in (each.first, each.second)]
    columns = ("conditions", "difference", "95% interval", "only first / only second", "p, adjusted")
    tests = dict.fromkeys(each.test_name for each in found)
    yield Table(columns, tuple(rows), title, f"p is of {', or of '.join(tests)}.")
    if len(results) > 2:
        cells = {(each.first.condition, each.second.condition): each for each in found}
        yield Table(
            ("", *(result.title for result in results)),
            tuple((row.title, *(_cell(row, column, cells) for column in results)) for row in results),
            f"{title}: each row's rate minus each column's, in points, over the models and episodes that both have",
            "With a star where p, adjusted, is below 0.05 and the interval leaves out 0, of two models of each at "
            "least; with a ring (°) where only p is.",
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
            mark = "*" if each.is_clear else "°" if each.is_significant else ""
            return f"{points(sign * each.test.difference)}{mark}"
    return "-" if row == column else "?"
