"""A SpaceMouse on the server's machine, simulated at its boundary, and key maps of the user's own."""

from __future__ import annotations

import sys
from types import ModuleType

import pytest

from tests.teleoperation.test_spacemouse import LEFT_BUTTON, LET_GO, NO_BUTTON, PUSHED_AWAY, SimulatedDevice, interface


@pytest.fixture
def device(monkeypatch) -> SimulatedDevice:
    """The device that is plugged in."""
    device = SimulatedDevice()
    device.open_path = lambda path: None
    library = ModuleType("hidraw")
    library.enumerate = lambda: [interface()]
    library.device = lambda: device
    monkeypatch.setitem(sys.modules, "hidraw", library)
    return device


def test_it_moves_the_arm_while_the_page_is_there_and_keys_work_besides(page, device):
    page.begin(spacemouse=True)
    assert page.status["spacemouse"]
    device.reports.put(PUSHED_AWAY)
    page.until(lambda: page.steps() >= 5)
    device.reports.put(LET_GO)
    page.until(lambda: page.status["phase"] == "idle")
    page.until(lambda: page.status["phase"] == "recording", "KeyA")
    device.reports.put(LEFT_BUTTON)
    page.until(lambda: page.status["gripper_closes"])


def test_it_is_left_alone_unless_it_is_asked_for(page, device):
    page.begin()
    device.reports.put(PUSHED_AWAY)
    seen = len(page.frames)
    page.until(lambda: len(page.frames) > seen + 10)
    assert page.steps() == 0
    assert not page.status["spacemouse"]
    assert not device.reports.empty()


def test_the_arm_stands_when_the_page_is_silent_whatever_is_pushed(page, device):
    page.begin(spacemouse=True)
    device.reports.put(PUSHED_AWAY)
    page.until(lambda: page.steps() >= 3)
    seen = len(page.frames)
    page.until(lambda: len(page.frames) > seen + 20 and page.status["phase"] == "paused", silent=True)
    steps, seen = page.steps(), len(page.frames)
    page.until(lambda: len(page.frames) > seen + 20, silent=True)
    assert page.steps() == steps
    page.until(lambda: page.status["phase"] == "recording")


def test_unplugged_in_mid_motion_it_lets_go_of_the_arm_and_the_page_says_so(page, device):
    page.begin(spacemouse=True)
    device.reports.put(PUSHED_AWAY)
    page.until(lambda: page.steps() >= 5)
    device.reports.put(None)
    page.until(lambda: not page.status["spacemouse"])
    page.until(lambda: page.status["phase"] == "paused", silent=True)
    assert "the SpaceMouse was unplugged" in page.status["problem"]
    assert device.is_closed
    page.until(lambda: page.status["phase"] == "recording", "KeyA")


def test_a_press_before_another_page_takes_over_is_not_done_again(page, connect, device):
    page.begin(spacemouse=True)
    for report in (LEFT_BUTTON, NO_BUTTON):
        device.reports.put(report)
    page.until(lambda: page.status["gripper_closes"])
    page.until(lambda: page.steps() >= 15, "KeyA")
    other = connect()
    other.say({"kind": "take over"})
    other.until(lambda: other.status.get("drives", False) and "step" in other.status, silent=True)
    steps = other.steps()
    other.until(lambda: other.steps() >= steps + 3, "KeyA")
    assert other.status["gripper_closes"]


def test_one_that_cannot_be_had_is_a_sentence_and_what_goes_on_goes_on(page, monkeypatch):
    page.begin()
    monkeypatch.setitem(sys.modules, "hidraw", None)
    page.say({"kind": "begin", "task": "one_leg", "spacemouse": True})
    page.until(lambda: len(page.refusals) == 1)
    assert "hidapi, which is not installed" in page.refusals[0]
    assert page.status["going_on"]


def test_it_is_let_go_when_the_session_ends_or_cannot_begin(page, device):
    page.say({"kind": "begin", "task": "rocket", "spacemouse": True})
    page.until(lambda: device.is_closed and len(page.refusals) == 1, silent=True)
    device.is_closed = False
    page.begin(spacemouse=True)
    page.say({"kind": "end"})
    page.until(lambda: not page.status["going_on"], silent=True)
    assert device.is_closed


def test_own_key_maps_are_offered_and_the_list_of_keys_shows_them(connect, tmp_path):
    folder = tmp_path / "teleoperation"
    folder.mkdir()
    (folder / "mine.toml").write_text('[keys]\ngripper = "KeyF"\n')
    page = connect()
    assert page.greeting["key_maps"][-1] == "mine.toml"
    assert page.greeting["problems"] == []
    page.begin(keys="mine.toml")
    assert page.status["keys"] == "mine.toml"
    assert {"meaning": "gripper", "text": "close or open the gripper", "keys": ["KeyF"], "is_motion": False} in (
        page.status["key_list"]
    )
    page.press("KeyF")
    page.until(lambda: page.status["gripper_closes"])


def test_a_bad_key_map_is_a_sentence_when_the_page_opens_and_is_not_offered(connect, tmp_path):
    folder = tmp_path / "teleoperation"
    folder.mkdir()
    (folder / "bad.toml").write_text('[keys]\ngripper = "KeyW"\n')
    (folder / "broken.toml").write_text("[keys\n")
    page = connect()
    first, second = page.greeting["problems"]
    assert "'KeyW' is bound to both" in first
    assert "is not valid TOML" in second
    assert set(page.greeting["key_maps"]) == {"original", "isaaclab", "robosuite"}
