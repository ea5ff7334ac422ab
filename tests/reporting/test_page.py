"""Claims about the report as a file, and about what it says."""

from __future__ import annotations

import base64
import re
from dataclasses import replace
from datetime import datetime
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from juicer.reporting.content import EstimatorErrors, EvaluatedEpisode, Funnel, ReportData, TrainingCurve
from juicer.reporting.page import render_page, write_page

VOID = {"meta", "link", "br", "img", "input"}


class TagBalance(HTMLParser):
    """Fails on a closing tag that closes nothing, and collects what the page would load."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.loaded: list[str] = []
        self.links: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in VOID:
            self.open.append(tag)
        loading = {"src", "href", "xlink:href", "srcset", "data", "poster"}
        targets = [value or "" for name, value in attrs if name in loading]
        # A link loads nothing before it is followed.
        (self.links if tag == "a" else self.loaded).extend(targets)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def text_of(page: str) -> str:
    """What a reader sees, with single spaces."""
    without_style = re.sub(r"<(style|script)>.*?</\1>", "", page, flags=re.DOTALL)
    return " ".join(re.sub(r"<[^>]+>", " ", without_style).split())


def test_page_is_well_formed_and_loads_nothing_from_elsewhere(report_data: ReportData):
    page = render_page(report_data)
    parser = TagBalance()
    parser.feed(page)
    assert parser.open == []
    assert all(target.startswith(("#", "data:")) for target in parser.loaded)
    assert all(target.startswith(("#", "data:", "https://mlflow.example.org/")) for target in parser.links)
    assert "fetch(" not in page
    assert "import" not in page[page.index("<script>") :]
    assert "url(http" not in page
    assert "@import" not in page


def test_page_says_what_was_measured(report_data: ReportData):
    text = text_of(render_page(report_data))
    assert "TA+CI succeeds in 91% of 100 episodes (95% interval 84 to 95%)" in text
    assert "BC 52% 42% to 62% 52% 1 100 59% / 68%" in text
    assert "BC → TA+CI +39 points" in text
    assert "Most are lost between over hole and inserted: 16 of 100." in text
    assert "juicer ui" in text


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
    assert page.count("<script") == 1


@pytest.mark.parametrize(
    "text", ["$\\\\frac{$", "\x1b[31m\x00", "\ud800", "\u202egnp.exe", "&amp;<!--", "]]></script>"]
)
def test_a_text_of_any_letters_is_shown_and_steers_nothing(report_data: ReportData, tmp_path: Path, text: str):
    curve = TrainingCurve(text, np.arange(3), {text: np.array([1.0, np.nan, np.inf])}, group=text)
    funnel = Funnel(text, 0, {text: 0})
    episode = EvaluatedEpisode(0, 3_000_000, text, 0, 5, {text: 2, "b": 1})
    model = replace(report_data.models[0], condition=text, milestones=(text,), episodes=(episode,))
    node = replace(report_data.lineage[0], label=text)
    data = replace(
        report_data,
        title=text,
        findings=(text,),
        facts={text: text},
        funnels=(funnel,),
        curves=(curve, *report_data.curves),
        models=(model,),
        lineage=(node,),
        augmentations=(replace(report_data.augmentations[0], label=text, rejected={text: 3}),),
        estimators=(EstimatorErrors(text, {text: (1.0, 2.0)}),),
    )
    write_page(data, tmp_path / "report.html")
    page = (tmp_path / "report.html").read_bytes().decode("utf-8")
    parser = TagBalance()
    parser.feed(page)
    assert parser.open == []
    assert page.count("<script>") == page.count("</script>") == 1
    assert not re.search("[\x00-\x08\x0b-\x1f\x7f\u202e\ud800]", page)


def test_the_error_of_an_estimator_is_told_for_each_critical_state(report_data: ReportData):
    assert "one_leg insert leg 0.9 mm 1.3°" in text_of(render_page(report_data))
    assert "What is read off images" not in text_of(render_page(replace(report_data, estimators=())))


def test_videos_and_stills_are_part_of_the_page(report_data: ReportData):
    page = render_page(report_data)
    assert page.count('src="data:image/webp;base64,') == 20
    assert page.count('src="data:video/mp4;base64,') == 2
    assert (
        len(re.findall(r'<video controls muted playsinline preload="metadata"[^>]* poster="data:image/webp', page)) == 2
    )
    assert "step 141 · 14.1&nbsp;s" in page
    assert not re.search(r"<img(?![^>]*alt=\"[^\"]+\")", page)


def test_every_episode_is_listed_with_the_command_that_replays_it(report_data: ReportData):
    page = render_page(report_data)
    for model in report_data.models:
        assert f'data-evaluation="{model.evaluation}"' in page
    lists = re.findall(r'<pre class="rows"[^>]*>(.*?)</pre>', page, flags=re.DOTALL)
    assert [len(text.splitlines()) for text in lists] == [100, 100]
    first = "0\t3000000\tsuccess\t1\t423\ttop placed 60, leg lifted 120, leg upright 180"
    assert lists[1].startswith(first)
    assert "92 of 100 succeed" in text_of(page) or "91 of 100 succeed" in text_of(page)


def test_thousands_of_episodes_stay_a_light_page(report_data: ReportData):
    before = len(render_page(report_data))
    many = tuple(replace(report_data.models[0], seed=seed) for seed in range(40))
    added = len(render_page(replace(report_data, models=many))) - before
    assert added < 1_000_000


def test_the_way_to_make_it_again_is_told(report_data: ReportData):
    page = render_page(report_data)
    assert "git checkout 2b0e8fd4b356c8be3a411328cb7838f5ec18956c\njuicer run one_leg.yaml" in page
    assert "flow: study" in page
    saved = re.search(r'download="one_leg.yaml" href="data:application/yaml;base64,([^"]*)"', page)
    assert saved
    assert base64.b64decode(saved[1]).decode() == "flow: study\nname: one_leg\n"


@pytest.mark.parametrize("address", ["javascript:alert(1)", "data:text/html,x", "file:///etc/passwd", "http://[", ""])
def test_only_web_addresses_become_links(report_data: ReportData, address: str):
    provenance = replace(report_data.provenance, links={"MLflow": address})
    page = render_page(replace(report_data, provenance=provenance))
    assert f'href="{address}"' not in page


def test_runs_are_laid_over_each_other_and_told_apart_by_a_legend(report_data: ReportData):
    page = render_page(report_data)
    for number, name in enumerate(("BC", "TA", "TA+CI")):
        assert page.count(f'class="run-group-{number}"') == 2
        assert f'<i class="c{number} d0"></i>{name}' in page
    assert "Each run by itself (3)" in page


def test_lineage_is_drawn_for_wide_and_for_narrow_pages(report_data: ReportData):
    page = render_page(report_data)
    assert page.count('only-wide"') == page.count('only-narrow"') == 3


def test_colours_are_the_pages_in_light_and_dark(report_data: ReportData):
    page = render_page(report_data)
    assert "prefers-color-scheme: dark" in page
    charts = re.findall(r'<svg class="chart".*?</svg>', page, flags=re.DOTALL)
    assert len(charts) == 9
    assert not any(re.search(r"#[0-9a-f]{6}", chart) for chart in charts)


def test_page_is_written_as_utf8(report_data: ReportData, tmp_path: Path):
    write_page(report_data, tmp_path / "report.html")
    assert "BC → TA+CI" in (tmp_path / "report.html").read_text(encoding="utf-8")
