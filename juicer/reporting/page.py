"""Build the page."""

from __future__ import annotations

from pathlib import Path

from juicer.reporting.content import ReportData


def render_page(data: ReportData) -> str:
    """HTML of the report: one file that loads nothing from anywhere."""
    raise NotImplementedError(data.title)


def write_page(data: ReportData, path: Path) -> None:
    """Write the report to ``path``."""
    path.write_text(render_page(data), encoding="utf-8")
