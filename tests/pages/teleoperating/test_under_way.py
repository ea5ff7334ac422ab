"""How many frames are on their way to a page depends on how long its line is, not on how thin."""

from __future__ import annotations

import pytest

from juicer.pages.teleoperating.under_way import FEWEST, MOST, UnderWay
from juicer.teleoperation.session import FRAME_S


def frames_under_way(round_trip_s: float, frame_s: float = 0.0, seconds: float = 20.0) -> tuple[float, int]:
    """Frames a second, and the most on their way at once, on a line that needs some time for every frame by itself."""
    under_way, arrivals, line_is_free_s = UnderWay(), [], 0.0
    painted, most = 0, 0
    for tick in range(int(seconds / FRAME_S)):
        now = tick * FRAME_S
        while arrivals and arrivals[0][0] <= now:
            at, number = arrivals.pop(0)
            under_way.painted(number, at)
            painted += 1
        if not under_way.is_full:
            under_way.send(tick, now)
            line_is_free_s = max(line_is_free_s, now) + frame_s
            arrivals.append((line_is_free_s + round_trip_s, tick))
            most = max(most, len(arrivals))
    return painted / seconds, most


@pytest.mark.parametrize("round_trip_s", [0.005, 0.03, 0.1, 0.2, 0.3])
def test_a_long_line_gets_every_frame(round_trip_s):
    rate, most = frames_under_way(round_trip_s)
    assert rate == pytest.approx(1 / FRAME_S, rel=0.03)
    assert most <= round_trip_s / FRAME_S + FEWEST


def test_on_a_thin_line_no_frame_waits_for_more_than_two_others():
    frame_s = 0.12
    rate, most = frames_under_way(0.02, frame_s)
    assert rate == pytest.approx(1 / frame_s, rel=0.1)
    assert most <= FEWEST + 2


def test_a_page_that_never_answers_or_late_gets_a_few_frames_at_most():
    under_way = UnderWay()
    under_way.send(0, 0.0)
    under_way.painted(0, 1000.0)
    for number in range(1, 1 + MOST):
        assert not under_way.is_full
        under_way.send(number, 1000.0)
    assert under_way.is_full


def test_what_was_not_sent_or_is_acknowledged_twice_counts_nothing():
    under_way = UnderWay()
    for number in range(FEWEST):
        under_way.send(number, 0.0)
    under_way.painted(99, 0.0)
    assert under_way.is_full
    under_way.painted(0, 0.01)
    under_way.send(FEWEST, 0.01)
    under_way.painted(0, 0.02)
    assert under_way.is_full
