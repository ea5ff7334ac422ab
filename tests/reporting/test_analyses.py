"""Figures of analyses are drawn whatever was found, and the page shows them with their numbers."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import PIL.Image
import pytest

from juicer.analysis.monitoring import Watched
from juicer.reporting.analyses import AnalysisRow
from juicer.reporting.analysis_figures import modes_figure, monitor_figure, sampling_figure
from juicer.reporting.content import ShownAnalysis
from juicer.reporting.page import render_page
from juicer.storage.analyses import ModesRow

RNG = np.random.default_rng(0)


def watched(failing, succeeding, steps=30):
    """Rollouts of which the failing ones spread more and more."""
    drift = np.linspace(0, 3, steps)
    traces = [RNG.gamma(4, 0.3, steps) + drift for _ in range(failing)]
    traces += [RNG.gamma(4, 0.3, 20) for _ in range(succeeding)]
    lengths = [4 * steps] * failing + [80] * succeeding
    return Watched.of(traces, [True] * failing + [False] * succeeding, lengths, stride=4, window=5)


FIGURES = {
    "sampling": lambda: sampling_figure(
        {steps: RNG.normal(scale=1 / steps, size=(200, 7)) for steps in (1, 2, 100)},
        {"1": 1.2, "2": 0.4, "chance": 0.05},
    ),
    "sampling in one number of steps": lambda: sampling_figure({8: np.zeros((5, 7))}, {"chance": 0.0}),
    "modes": lambda: modes_figure(
        [ModesRow(1, 50, 39, 0.65, 0.87, 1.0, 15.0), ModesRow(256, 50, 44, 0.76, 0.94, 0.06, 120.0)]
    ),
    "monitor": lambda: monitor_figure(watched(30, 90), "position_mm", 76, watched(30, 90).alarms(0.05).leads),
    "monitor without alarms": lambda: monitor_figure(watched(0, 5), "position_mm", None, ()),
}


@pytest.mark.parametrize("draw", FIGURES.values(), ids=FIGURES.keys())
def test_a_figure_is_a_picture_with_something_in_it(draw):
    image = np.asarray(PIL.Image.open(io.BytesIO(draw())).convert("L"))
    assert image.shape[1] > 1000
    assert (image < 200).mean() > 0.005


def test_the_page_shows_an_analysis_with_its_numbers_as_text(report_data):
    shown = ShownAnalysis("<b>fig4</b>: BC, seed 0", "One & two.", ("steps", "x"), (("1", "0.5"),), FIGURES["modes"]())
    page = render_page(replace(report_data, analyses=(shown, replace(shown, png=b"", rows=()))))
    assert page.count("data:image/png;base64,") == 1
    assert "&lt;b&gt;fig4&lt;/b&gt;: BC, seed 0" in page
    assert "One &amp; two." in page
    assert '<td data-label="x">0.5</td>' in page
    assert 'href="#analyses"' in page
    assert 'href="#analyses"' not in render_page(replace(report_data, analyses=()))


def test_an_analysis_has_a_file_name_that_every_system_takes():
    assert AnalysisRow(name="fig4", condition="ta_ci", title="TA+CI (images)", seed=2).file_name == "fig4.ta_ci.2"
