"""Section on scenes unlike those of training: rates under every shift, and which differences are more than chance."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from juicer.reporting.comparison import robustness_table, shift_names
from juicer.reporting.section import Section, Table
from juicer.study.material import TaskStudy
from juicer.study.statistics import differences
from juicer.study.success import paired_tests


def robustness_section(studies: Sequence[TaskStudy]) -> Section | None:
    """Rates without a shift and under each, a column a shift; nothing if none was measured under any."""
    tables = tuple(table for study in studies for table in _tables(study))
    if not tables:
        return None
    return Section(
        "shifts",
        "Under shifts",
        "How often policies succeed in scenes unlike those of training",
        "The same models from the same initial-state seeds, in scenes that differ from all that training has seen; "
        "rates with 95 % intervals. A policy that sees no images cannot notice another light or camera. Tests are as "
        "those of the usual scenes.",
        tables,
    )


def _tables(study: TaskStudy) -> Iterator[Table]:
    for alike, results in study.tested_together:
        if any(found for result in results for found in result.shifted.values()):
            columns, rows = robustness_table(results)
            yield Table(tuple(columns), tuple(map(tuple, rows)), f"{study.task}{alike}")
        for name in shift_names(results):
            shifted = [found for result in results if (found := result.shifted.get(name))]
            if tested := differences(shifted, study.untrained):
                yield from paired_tests(f"{study.task}{alike}, under {name}", shifted, tested)
