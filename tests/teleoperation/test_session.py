"""The live session, in real time."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import pytest

from juicer.sim.env import STEP_S
from juicer.teleoperation.controls import ControllerState, Controls
from juicer.teleoperation.session import Session
from juicer.teleoperation.status import Phase, Snapshot
from juicer.teleoperation.work import STANDING_STEPS, Ending

CLOCK_S = 0.15
"""How late a thread may be on a machine that computes other things."""


@pytest.fixture
def session(work):
    session = Session(work)
    session.take_over(Controls())
    session.start()
    yield session
    session.close()


def wait_for(session: Session, test: Callable[[Snapshot], bool], hold: tuple[str, ...] | None = None) -> Snapshot:
    """The first moment that passes a test, while keys are held, or nothing is said if None."""
    end = time.monotonic() + 30
    number = -1
    while time.monotonic() < end:
        if hold is not None:
            wait_for.sequence += 1
            session.hear(ControllerState(source="keyboard", sequence=wait_for.sequence, held=frozenset(hold)))
        snapshot = session.newer(number, 1.0)
        assert snapshot
        if test(snapshot):
            return snapshot
        number = snapshot.number
    raise AssertionError("it never came")


wait_for.sequence = 0


def test_held_keys_are_recorded_as_long_as_they_are_held(session):
    moment = wait_for(session, lambda now: now.status.step >= 5, ("KeyA",))
    assert moment.status.phase is Phase.RECORDING
    assert moment.status.acted == moment.status.step
    assert moment.moved_by > 0


def test_silence_stops_the_arm_and_the_recording(session):
    wait_for(session, lambda now: now.status.step >= 5, ("KeyA",))
    gone = wait_for(session, lambda now: now.status.phase is Phase.PAUSED)
    time.sleep(0.5)
    assert session.latest.status.step - gone.status.step < STANDING_STEPS
    wait_for(session, lambda now: now.status.phase is Phase.RECORDING, ("KeyA",))


def test_released_controls_stop_the_arm_within_two_steps(session):
    wait_for(session, lambda now: now.status.step >= 5, ("KeyA",))
    session.release()
    before = session.latest.status.step
    wait_for(session, lambda now: now.status.phase is Phase.PAUSED)
    time.sleep(0.5)
    # One more may have been under way.
    assert session.latest.status.step <= before + STANDING_STEPS + 1


@pytest.mark.parametrize("time_scale", [1.0, 0.25])
def test_by_the_clock_the_arm_stands_three_steps_after_it_is_released(session, time_scale):
    step_s = STEP_S / time_scale
    session.pace(time_scale, 5.0)
    wait_for(session, lambda now: now.status.step >= 3, ("KeyA",))
    session.release()
    released = time.monotonic()
    paused = wait_for(session, lambda now: now.status.phase is Phase.PAUSED)
    assert paused.at_s - released <= step_s + CLOCK_S
    standing = wait_for(session, lambda now: now.at_s >= released + (1 + STANDING_STEPS) * step_s + CLOCK_S)
    later = wait_for(session, lambda now: now.at_s >= standing.at_s + 2 * step_s)
    assert later.status.step == standing.status.step
    np.testing.assert_array_equal(later.qpos, standing.qpos)


def test_a_slower_pace_records_the_same_steps_in_more_time(session, work):
    session.pace(0.25, 5.0)
    wait_for(session, lambda now: now.status.step >= 1, ("KeyA",))
    numbers = [wait_for(session, lambda now, n=n: now.status.step >= n, ("KeyA",)).number for n in (2, 3)]
    assert numbers[1] - numbers[0] > 4, "eight moments are shown a step, if none is late"
    assert work.env.data.time == pytest.approx(0.1 * len(work.take))


def test_moments_between_two_steps_are_shown(session):
    wait_for(session, lambda now: now.status.step >= 3, ("KeyA",))
    shown = []
    for _ in range(6):
        shown.append(session.latest)
        wait_for(session, lambda now: now.number > shown[-1].number, ("KeyA",))
    different = {moment.qpos.tobytes() for moment in shown}
    assert len(different) > len({moment.status.step for moment in shown})


def test_what_the_disk_refused_is_tried_again_without_a_press(session, work, monkeypatch):
    monkeypatch.setattr("juicer.teleoperation.session.LAST_LOOK_S", 0.0)
    wait_for(session, lambda now: now.status.step >= 1, ("KeyA",))
    seeds = work.logs.folder / "seeds"
    seeds.rename(work.logs.folder / "aside")
    seeds.touch()
    work.ending = Ending.KEPT
    refused = wait_for(session, lambda now: "no other can begin" in now.status.sentence)
    seeds.unlink()
    (work.logs.folder / "aside").rename(seeds)
    begun = wait_for(session, lambda now: now.status.seed != refused.status.seed)
    assert begun.status.step == 0
    assert 0.5 < begun.at_s - refused.at_s < 5


def test_a_defect_is_said_and_what_was_recorded_stays(session, work, monkeypatch):
    wait_for(session, lambda now: now.status.step >= 5, ("KeyA",))

    def fail(*_, **__):
        raise ZeroDivisionError

    monkeypatch.setattr(work, "step", fail)
    moment = wait_for(session, lambda now: now.status.phase is Phase.OVER, ("KeyA",))
    assert "defect" in moment.status.sentence
