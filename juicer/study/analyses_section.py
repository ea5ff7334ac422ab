"""Section on what else is known of policies: their samples, modes of these, and failures told beforehand."""

from __future__ import annotations

from collections.abc import Sequence

from juicer.reporting.section import Chart, Section, Table
from juicer.study.material import TaskStudy


def analyses_section(studies: Sequence[TaskStudy]) -> Section | None:
    """Every analysis with its figure and its numbers."""
    found = [(study.task, row, shown) for study in studies for row, shown in study.analyses]
    if not found:
        return None
    hours = sum(shown.cpu_seconds for _, _, shown in found) / 3600
    return Section(
        "analyses",
        "Analyses",
        "What policies predict, beside how often they succeed",
        f"How each is made stands in docs/analyses.md. Together they took {hours:.1f} CPU-hours, which "
        "are not part of the cost below.",
        tuple(
            Table(shown.columns, shown.rows, f"{task}, {shown.label}", "" if shown.png else shown.sentence)
            for task, _, shown in found
            if shown.rows
        ),
        tuple(
            Chart(f"{task}_{row.file_name}", f"{task}, {shown.label}", "", shown.png, shown.sentence)
            for task, row, shown in found
            if shown.png
        ),
    )
