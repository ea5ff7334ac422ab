"""The paper's figures stand beside the conditions that its tables are of."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from juicer.evaluation import summarise
from juicer.reporting.content import ReportData
from juicer.reporting.page import render_page
from juicer.reporting.paper import PAPER_TABLE_VII, paper_figures


def test_a_run_that_compares_encoders_shows_the_papers_averages_of_them(report_data: ReportData):
    figures = paper_figures("one_leg")
    assert (figures["r3m_18"], figures["ta_ci"], "r3m_18" in paper_figures("lamp")) == ((0.77,), (0.74, 0.85), False)
    encoder = summarise("r3m_18", report_data.results[0].models, "R3M, ResNet18")
    page = render_page(replace(report_data, results=(encoder,), paper=figures))
    assert '<td data-label="paper, average / best">77%</td>' in page


def test_the_documentation_says_how_conditions_are_called_for_it():
    page = (Path(__file__).parents[2] / "docs" / "encoders.md").read_text()
    assert [name for name in PAPER_TABLE_VII if f"`{name}`" not in page] == []
