"""What people see of a run."""

from __future__ import annotations

import io
import time

import pytest
from rich.console import Console

from flows.terminal.progress import Board
from flows.terminal.time_left import Call


@pytest.fixture
def output():
    return io.StringIO()


class Clock:
    def __init__(self):
        self.seconds = 1000.0

    def __call__(self):
        return self.seconds


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def board(output, clock):
    return Board(Console(file=output, width=160), workers=2, clock=clock)


def test_plain_lines_tell_beginning_advance_time_left_and_end(board, output, clock):
    with board:
        board.expect({"train": Call("train", "bc seed 0"), "evaluate": Call("evaluate", "bc seed 0", 60.0)})
        progress = board.started("train", "bc seed 0", "train")
        clock.seconds += 14
        progress(49, 200, loss=0.5)
        clock.seconds += 6
        progress(50, 200, loss=0.25)
        board.finished("train", "bc seed 0", "train", "done", {"headline": "steps 200, loss 0.125"})
        board.finished("evaluate", "bc seed 0", "evaluate", "reused", {})
    lines = output.getvalue().splitlines()
    assert "train     bc seed 0" in lines[0]
    assert "begins" in lines[0]
    assert "50/200  25%" in lines[1]
    assert "1:00 left  loss 0.25" in lines[1]
    assert "0:20 so far, 0 stages done, 2 to go, about 1:00 left" in lines[1]
    assert "✓ train" in lines[2]
    assert "steps 200, loss 0.125" in lines[2]
    assert "reused" in lines[3]


def test_an_artifact_of_an_earlier_version_has_its_counts_for_a_headline(board, output):
    summary = {"episodes": 8, "is_new": True, "milestones": {"leg": 3}, "success_rate": 0.375, "successes": 3}
    board.finished("evaluate", "bc seed 0", "evaluate", "reused", summary)
    assert "reused  episodes 8, successes 3\n" in output.getvalue()


def test_a_plain_line_without_facts_has_no_gap(board, output, clock):
    with board:
        progress = board.started("replay", "episode.mp4", "replay")
        clock.seconds += 15
        progress(1, 2)
    assert "0:15 left; 0:15 so far" in output.getvalue()


def test_estimate_admits_what_it_does_not_know(board):
    board.expect({"train": Call("train", "a", 100.0), "evaluate": Call("evaluate", "a")})
    assert board.seconds_left() == (50.0, False)
    board.finished("evaluate", "a", "evaluate", "reused", {})
    assert board.seconds_left() == (50.0, True)


def test_own_estimate_of_a_stage_is_believed(board):
    board.started("train", "a", "train")(1, 1000, seconds_left=30)
    assert board.seconds_left()[0] == 30.0


def test_live_lines_leave_only_the_finished_ones(output):
    with Board(Console(file=output, width=120, force_terminal=True)) as board:
        board.started("collect", "ta_ci seed 0 round 1", "collect")(3, 10, successes=2)
        time.sleep(0.3)
        board.finished("collect", "ta_ci seed 0 round 1", "collect", "failed", {"reason": "no space"})
    assert "3/10" in output.getvalue()
    assert "no space" in output.getvalue()


def test_rejected_logs_are_listed_when_they_are_rejected_and_not_again(board, output):
    rejections = {f"{number:02}.npz": "the operator marked it as failed" for number in range(25)}
    for state in ("done", "reused"):
        board.started("ingest", "", "ingest")
        board.finished("ingest", "", "ingest", state, {"episodes": 1, "rejected": 130, "rejections": rejections})
    lines = [line.strip() for line in output.getvalue().splitlines() if "npz" in line or "more" in line]
    assert lines[0] == "00.npz: the operator marked it as failed"
    assert lines[20:] == ["and 110 more; see `juicer show`"]


def test_an_augmentation_that_counts_its_rejections_lists_none(board, output):
    board.started("augment", "", "augment")
    board.finished("augment", "", "augment", "done", {"snippets": 192, "rejections": {"part_position": 24}})
    assert "part_position" not in output.getvalue()
