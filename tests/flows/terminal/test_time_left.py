"""Time left is honest: replayed are reports of real rollouts, which took a minute each on two cores."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from flows.terminal.time_left import Call, Forecast, Work
from juicer.progress import EXPECTED_STEPS, SECONDS_LEFT, STEPS, EpisodeSteps

TRACES = sorted((Path(__file__).parent / "traces").glob("*.json"))
LAST_SECONDS = 10.0
"""Within which nobody minds whether it is one more or less."""


def estimates(trace, before=None):
    """What was shown at every turn of a rollout: seconds so far, seconds that were left, and the estimate."""
    steps = EpisodeSteps(trace["episodes"], trace["abreast"], trace["limit"], trace["successes"])
    work, done = Work(0.0, before), 0
    for now, running, ended in trace["turns"]:
        for length, succeeded in ended:
            steps.end(length, succeeded=bool(succeeded))
        steps.running = running
        done += len(ended)
        work.report(done, trace["episodes"], steps.facts(), now)
        yield now, trace["seconds"] - now, work.seconds_left(now)


@pytest.fixture(params=TRACES, ids=lambda path: path.stem)
def trace(request):
    return json.loads(request.param.read_text())


def test_there_are_traces():
    assert len(TRACES) == 3


def test_time_left_of_a_rollout_is_never_off_by_more_than_a_factor_of_two(trace):
    shown = [(now, left, told) for now, left, told in estimates(trace) if told is not None]
    assert shown[0][0] < 0.35 * trace["seconds"]
    for _, left, told in shown:
        assert left / 2 - LAST_SECONDS / 4 <= told <= 2 * left + LAST_SECONDS / 4


def test_nothing_is_said_before_anything_is_known(trace):
    first = next(turn for turn, (_, _, told) in enumerate(estimates(trace)) if told is not None)
    ended = sum(len(turn[2]) for turn in trace["turns"][: first + 1])
    assert ended >= 0.75 * trace["abreast"]


def test_until_then_the_last_run_of_the_kind_tells(trace):
    told = [told for _, _, told in estimates(trace, before=trace["seconds"])]
    assert told[0] == pytest.approx(trace["seconds"], rel=0.05)
    assert None not in told


def test_episodes_that_nobody_counts_promise_nothing():
    steps = EpisodeSteps(0, 4, 100, 2)
    steps.end(50, succeeded=True)
    assert steps.facts() == {STEPS: 50, EXPECTED_STEPS: 0}


def test_what_is_done_is_all_that_is_expected_at_the_end():
    steps = EpisodeSteps(2, 2, 100)
    steps.end(50, succeeded=True)
    steps.end(100, succeeded=False)
    assert steps.facts() == {STEPS: 150, EXPECTED_STEPS: 150}


def test_a_pace_is_told_only_after_some_way():
    work = Work(0.0)
    work.report(1, 100, {}, 10.0)
    assert work.seconds_left(10.0) is None
    work.report(10, 100, {}, 20.0)
    assert work.seconds_left(25.0) == pytest.approx(175.0)


def test_waiting_is_no_work():
    work = Work(0.0)
    work.report(0, 0, {"waiting_for": "cuda:0"}, 1000.0)
    work.report(50, 100, {}, 1010.0)
    assert work.seconds_left(1010.0) == pytest.approx(10.0)


def test_a_last_run_that_took_less_promises_nothing_any_more():
    work = Work(0.0, before=60.0)
    assert work.seconds_left(59.0) == 1.0
    assert work.seconds_left(61.0) is None


def test_a_run_adds_what_is_to_come_by_what_its_own_stages_took():
    forecast = Forecast(2, {"first": Call("train", "a"), "second": Call("train", "b")})
    forecast.begin("first", "train", 0.0).report(1, 2, {SECONDS_LEFT: 30}, 30.0)
    assert forecast.seconds_left(30.0) == (30.0, False)
    assert forecast.end("first", "train", 60.0, is_done=True) == 60.0
    assert forecast.seconds_left(60.0) == (30.0, True)


def test_what_is_settled_has_nothing_to_come_and_others_keep_theirs():
    calls = [("train", "bc seed 1 round 2"), ("evaluate", "bc seed 1"), ("evaluate", "bc seed 10")]
    forecast = Forecast(1, {label: Call(stage, label, 60.0) for stage, label in calls})
    forecast.drop("bc seed 1")
    assert forecast.seconds_left(0.0) == (60.0, True)


def test_of_calls_with_one_label_each_is_counted_and_lasts_as_long_as_its_own_like():
    forecast = Forecast(1, {"short": Call("evaluate", "a", 60.0), "long": Call("evaluate", "a", 900.0)})
    assert forecast.end("made before", "evaluate", 0.0, is_done=False) is None
    assert forecast.begin("long", "evaluate", 0.0).before == 900.0
    assert forecast.seconds_left(10.0) == (950.0, True)
    forecast.end("long", "evaluate", 900.0, is_done=True)
    assert forecast.seconds_left(900.0) == (60.0, True)
