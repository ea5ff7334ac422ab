"""A pace is kept, and what is lost is not made up for by hurrying."""

from __future__ import annotations

from juicer.teleoperation.beat import Beat


def test_a_small_delay_does_not_slow_the_pace():
    beat = Beat(0.0)
    assert beat.is_due(0.0)
    beat.wait(0.1, 0.0)
    assert not beat.is_due(0.05)
    assert beat.is_due(0.13)
    beat.wait(0.1, 0.13)
    assert beat.next_at == 0.2


def test_after_a_stall_the_pace_goes_on_from_there():
    beat = Beat(0.0)
    beat.wait(0.1, 0.0)
    assert beat.is_due(2.0)
    beat.wait(0.1, 2.0)
    assert not beat.is_due(2.05)
    assert beat.is_due(2.1)
