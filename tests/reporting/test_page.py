"""Claims about the report as a file, and about what it says."""

from __future__ import annotations

import re
from dataclasses import replace
from datetime import datetime
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from juicer.reporting.content import FilmStrip, Funnel, ReportData
from juicer.reporting.page import render_page, write_page


class TagBalance(HTMLParser):
    """Fails on a closing tag that closes nothing, and collects what the page would load."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.loaded: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in {"meta", "link", "br", "img"}:
            self.open.append(tag)
        self.loaded += [value or "" for name, value in attrs if name in {"src", "href", "xlink:href", "srcset", "data"}]

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in {"meta", "link", "br", "img"}:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def text_of(page: str) -> str:
    """What a reader sees, with single spaces."""
    without_style = re.sub(r"<style>.*?</style>", "", page, flags=re.DOTALL)
    return " ".join(re.sub(r"<[^>]+>", " ", without_style).split())


def test_page_is_well_formed_and_loads_nothing_from_elsewhere(report_data: ReportData):
    page = render_page(report_data)
    parser = TagBalance()
    parser.feed(page)
    assert parser.open == []
    assert all(target.startswith(("#", "data:")) for target in parser.loaded)
    assert "url(http" not in page
    assert "@import" not in page


def test_page_says_what_was_measured(report_data: ReportData):
    text = text_of(render_page(report_data))
    assert "TA+CI succeeds in 91% of 100 episodes (95% interval 84 to 95%)" in text
    assert "BC 52% 42% to 62% 52% 1 100 59% / 68%" in text
    assert "BC → TA+CI +39 points" in text
    assert "Most are lost between over hole and inserted: 16 of 100." in text
    assert "together 7 45.6 MB 25 min 06 s" in text
    assert "juicer ui" in text


def test_data_sizes_have_the_form_of_table_v(report_data: ReportData):
    text = text_of(render_page(report_data))
    assert "TA+CI 50 83 150 283 81 270 10%" in text


def test_equal_data_gives_an_equal_page(report_data: ReportData):
    assert render_page(report_data) == render_page(report_data)


def test_a_section_without_data_is_left_out():
    page = render_page(ReportData(title="Nothing yet", created=datetime(2026, 1, 1)))
    assert "<section" not in page
    assert 'href="#' not in page


def test_findings_are_told_even_without_any_result():
    finding = "No rollout succeeded."
    page = render_page(ReportData(title="Round 1", created=datetime(2026, 1, 1), findings=(finding,)))
    assert finding in page


def test_names_given_by_users_cannot_break_the_page(report_data: ReportData):
    hostile = '<script>alert("1")</script>\\1'
    funnel = Funnel(hostile, 3, {"lifted": 1})
    page = render_page(replace(report_data, title=hostile, funnels=(funnel,)))
    assert "<script" not in page


def test_every_frame_of_a_film_is_inlined(report_data: ReportData):
    page = render_page(report_data)
    assert page.count('src="data:image/webp;base64,') == 20
    assert "14.1 s" in page


def test_a_film_needs_a_time_for_each_frame(report_data: ReportData):
    film = FilmStrip("Success", "", np.zeros((2, 4, 4, 3), np.uint8), seconds=(0.0,))
    with pytest.raises(ValueError, match="argument 2 is shorter"):
        render_page(replace(report_data, films=(film,)))


def test_colours_are_the_pages_in_light_and_dark(report_data: ReportData):
    page = render_page(report_data)
    assert "prefers-color-scheme: dark" in page
    charts = re.findall(r'<svg class="chart".*?</svg>', page, flags=re.DOTALL)
    assert len(charts) == 7
    assert not any(re.search(r"#[0-9a-f]{6}", chart) for chart in charts)


def test_page_is_written_as_utf8(report_data: ReportData, tmp_path: Path):
    write_page(report_data, tmp_path / "report.html")
    assert "BC → TA+CI" in (tmp_path / "report.html").read_text(encoding="utf-8")
