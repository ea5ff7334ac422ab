"""Claims about charts drawn from awkward data."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
import pytest

from juicer.reporting.content import AugmentationYield, Funnel, TrainingCurve
from juicer.reporting.figures import curve_figure, funnel_figure, loss_limits, yield_figure


def test_loss_limits_hold_every_measured_loss():
    curve = TrainingCurve("BC", np.arange(3), {"training": np.array([1.0, 0.1, np.nan])})
    low, high = loss_limits([curve])
    assert low < 0.1
    assert high > 1.0


@pytest.mark.parametrize("losses", [{}, {"training": np.array([np.nan, np.nan])}, {"training": np.zeros(2)}])
def test_a_run_without_measured_losses_is_drawn_empty(losses: dict[str, np.ndarray]):
    curve = TrainingCurve("BC", np.arange(2), losses)
    assert "<svg" in curve_figure(curve, loss_limits([curve]))


def test_funnel_tells_counts_and_shares():
    drawing = funnel_figure(Funnel("BC", 8, {"leg_lifted": 6, "screwed": 2}))
    assert all(text in drawing for text in ("leg lifted", "6  (75%)", "2  (25%)"))


def test_yield_puts_the_commonest_reason_first():
    drawing = yield_figure(AugmentationYield("one_leg", 5, {"rare": 1, "common": 4}))
    assert drawing.index("common") < drawing.index("rare")


def test_yield_of_nothing_at_all_can_be_drawn():
    assert "kept" in yield_figure(AugmentationYield("one_leg", 0, {}))


def test_a_style_that_lies_in_the_working_directory_changes_nothing():
    funnel = Funnel("BC", 8, {"leg_lifted": 6})
    drawing = funnel_figure(funnel)
    with mpl.rc_context({"ytick.major.pad": 40, "patch.linewidth": 9}):
        assert funnel_figure(funnel) == drawing
