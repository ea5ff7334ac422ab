"""What the socket of teleoperation does with what may come over it."""

from __future__ import annotations

import errno
import os
import struct
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

from flows.servers.guard import Guard
from juicer.pages.access import Access
from juicer.pages.teleoperating.interrupted import MOST_DRAFTS
from juicer.pages.teleoperating.under_way import MOST
from juicer.sim.env import AssemblyEnv
from juicer.teleoperation.drafts import Beginning, Draft
from juicer.teleoperation.messages import MOST_BYTES
from juicer.teleoperation.painter import PANES
from juicer.teleoperation.seeds import SEEDS
from juicer.teleoperation.work import STANDING_STEPS
from tests.pages.teleoperating.talking import HEADER

TOKEN = "f" * 32


def test_page_is_served_with_nothing_inline(client):
    answer = client.get("/teleop")
    assert answer.status_code == 200
    assert "/static/teleop/main.js" in answer.text
    assert "style=" not in answer.text
    assert client.get("/static/teleop/main.js").status_code == 200


def test_the_greeting_names_what_can_be_chosen(page):
    assert {"one_leg", "lamp"} <= set(page.greeting["tasks"])
    assert page.greeting["randomness"] == ["low", "med", "high"]
    assert page.greeting["key_maps"][0] == "original"
    assert [pane["name"] for pane in page.greeting["panes"]] == [pane.name for pane in PANES]


def test_a_frame_carries_the_numbers_of_its_header_and_an_image_a_pane(page):
    page.begin()
    page.until(lambda: page.steps() >= 3, "KeyA")
    kind, count, _, number, heard, moved_by, step, sent_ms = HEADER.unpack_from(page.frames[0])
    assert (kind, count) == (1, len(PANES))
    lengths = struct.unpack_from(f"<{count}I", page.frames[0], HEADER.size)
    images = page.frames[0][HEADER.size + 4 * count :]
    assert sum(lengths) == len(images)
    assert images.startswith(b"\xff\xd8"), "JPEG"
    *_, last = page.frames
    _, _, _, later, last_heard, last_moved_by, last_step, later_ms = HEADER.unpack_from(last)
    assert later > number
    assert later_ms > sent_ms
    assert (heard, moved_by, step) == (-1, -1, 0)
    assert 0 < last_moved_by <= last_heard <= page.sequence
    assert 0 < last_step <= page.steps()


def test_an_image_that_has_not_changed_is_not_sent_again(page):
    page.begin()
    seen = len(page.frames)
    page.until(lambda: len(page.frames) > seen + 8, silent=True)
    *_, last = page.frames
    assert sum(struct.unpack_from(f"<{len(PANES)}I", last, HEADER.size)) == 0


def test_a_page_that_acknowledges_nothing_gets_no_further_frames(page):
    page.begin()
    while len(page.frames) < 2:
        page.hold("KeyA")
        page.hear(paints=False)
    for _ in range(30):
        page.hold("KeyA")
        page.hear(paints=False)
    unanswered = len(page.frames)
    assert unanswered <= 1 + MOST
    page.say({"kind": "painted", "number": HEADER.unpack_from(page.frames[-1])[3]})
    page.until(lambda: len(page.frames) > unanswered, "KeyA")


def test_replayed_and_overtaken_messages_are_answered_and_change_nothing(page):
    page.begin()
    page.sequence = 100
    page.press("KeyZ")
    page.until(lambda: page.status["gripper_closes"])
    replay = {"source": "keyboard", "sequence": page.sequence, "held": ["KeyA"], "edges": {"KeyZ": 2}}
    page.say(replay)
    page.say(replay | {"sequence": 50})
    page.until(lambda: len(page.refusals) == 2)
    assert all("repeated or overtaken" in sentence for sentence in page.refusals)
    assert page.status["gripper_closes"]


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        ("no JSON", "one JSON object"),
        ([1, 2], "one JSON object"),
        ({"kind": "fly"}, "kind"),
        ({"kind": "begin", "task": "one_leg", "target": -1}, "target"),
        ({"kind": "begin", "task": "rocket"}, "no task 'rocket'"),
        ({"kind": "begin", "task": "one_leg", "randomness": "wild"}, "unknown randomness 'wild'"),
        ({"kind": "begin", "task": "one_leg", "keys": "/etc/passwd"}, "no key map '/etc/passwd'"),
        ({"kind": "resume", "task": "..", "draft": "../../x"}, "no longer there"),
        ({"kind": "pace", "time_scale": 1e9, "undo_s": 1}, "time_scale"),
        ({"source": "keyboard", "sequence": 1, "held": ["Nonsense"], "edges": {}}, "a key or button that there is not"),
        ({"source": "keyboard", "sequence": 2**40}, "whole number"),
    ],
)
def test_what_no_page_says_is_answered_with_a_sentence(page, message, reason):
    page.say(message)
    page.until(lambda: len(page.refusals) == 1, silent=True)
    assert reason in page.refusals[0]


def test_an_oversized_message_ends_the_connection(page):
    page.say("x" * (MOST_BYTES + 1))
    with pytest.raises(WebSocketDisconnect) as closed:
        page.until(lambda: False, silent=True)
    assert closed.value.code == 1009


def test_a_binary_message_ends_the_connection(page):
    page._socket.send_bytes(b"\0" * 10)
    with pytest.raises(WebSocketDisconnect) as closed:
        page.until(lambda: False, silent=True)
    assert closed.value.code == 1003


def test_nonsense_without_end_ends_the_connection(page):
    for _ in range(60):
        page.say("nonsense")
    with pytest.raises(WebSocketDisconnect) as closed:
        page.until(lambda: False, silent=True)
    assert closed.value.code == 1008


def test_a_second_page_watches_and_cannot_steer_until_it_takes_over(page, connect):
    page.begin()
    other = connect()
    other.until(lambda: other.status.get("going_on", False), silent=True)
    assert not other.status["drives"]
    other.until(lambda: len(other.frames) > 5, "KeyA")
    assert other.steps() == 0
    assert len(other.refusals) == 1, "it is told once that what it sends does not count"
    assert "another page has the controls, so that what you send does not count" in other.refusals[0]
    other.say({"kind": "begin", "task": "lamp"})
    other.until(lambda: len(other.refusals) == 2, silent=True)
    assert "another page has the controls; take them over before you begin" in other.refusals[1]
    other.say({"kind": "take over", "operator": "Ben"})
    other.until(lambda: other.status["drives"], silent=True)
    other.until(lambda: other.steps() >= 3, "KeyA")
    assert other.status["operator"] == "Ben"
    page.until(lambda: not page.status["drives"], silent=True)
    other.say({"kind": "release"})
    other.until(lambda: other.status["phase"] == "paused", silent=True)
    seen = len(page.frames)
    page.until(lambda: len(page.frames) > seen + 10, "KeyD")
    assert page.status["phase"] == "paused"


def test_a_page_that_does_not_drive_is_told_that_its_orders_do_not_count(page, connect):
    page.begin()
    other = connect()
    other.until(lambda: other.status.get("going_on", False), silent=True)
    orders = {"end the episode": {"kind": "end"}, "change the pace": {"kind": "pace", "time_scale": 0.5, "undo_s": 5}}
    for number, (what, order) in enumerate(orders.items()):
        other.say(order)
        other.until(lambda number=number: len(other.refusals) > number, silent=True)
        assert f"another page has the controls; take them over before you {what}" in other.refusals[number]
    assert page.status["going_on"]


def test_what_nobody_drives_any_more_anybody_may_end(page, connect):
    other = connect()
    page.say({"kind": "take over"})
    page.begin()
    other.until(lambda: other.status.get("going_on", False), silent=True)
    page._socket.close()
    other.until(lambda: not other.status["is_driven"], silent=True)
    other.until(lambda: other.refusals, "KeyA")
    assert "nobody has the controls, so that what you send does not count; take them over" in other.refusals[0]
    other.say({"kind": "begin", "task": "lamp"})
    other.until(lambda: other.status.get("task") == "lamp", silent=True)
    assert other.status["drives"]


def test_whoever_drives_is_told_what_becomes_of_the_episode_though_nothing_can_be_drawn_any_more(page, monkeypatch):
    page.begin()
    page.until(lambda: page.steps() >= 2, "KeyA")

    def fail(*_):
        raise RuntimeError("the context is lost")

    monkeypatch.setattr("juicer.teleoperation.painter._Brush.draw", fail)
    page.until(lambda: page.status["problem"], "KeyA")
    assert "no more images can be drawn (the context is lost); choose another task" in page.status["problem"]
    steps = page.steps()
    page.until(lambda: page.steps() >= steps + 5, "KeyA")
    assert page.refusals == []


def test_a_device_takes_over_what_the_page_has_begun_and_the_arm_follows_it(page, connect):
    page.begin()
    device = connect()
    device.say({"kind": "numbers"})
    device.say({"kind": "take over", "operator": "Ben"})
    device.until(lambda: device.status.get("drives", False) and "numbers" in device.status, silent=True)
    before = device.status["numbers"]["proprioception"][:3]

    def follow() -> None:
        device.sequence += 1
        state = {"source": "pose", "sequence": device.sequence, "clutch": True, "edges": {"clutch": 1}}
        device.say({**state, "pose_delta": [0, min(0.002 * device.sequence, 0.1), 0, 0, 0, 0]})
        device.hear()

    end = time.monotonic() + 60
    while device.status["numbers"]["proprioception"][1] < before[1] + 0.03:
        assert time.monotonic() < end, "the arm does not follow"
        follow()
    assert device.status["operator"] == "Ben"
    assert device.refusals == []


def test_presses_made_in_vain_do_not_count_after_taking_over(page, connect):
    page.begin()
    other = connect()
    other.press("KeyZ")
    other.press("KeyZ")
    other.press("KeyZ")
    other.until(lambda: other.status.get("going_on", False), silent=True)
    other.say({"kind": "take over"})
    other.until(lambda: other.status["drives"] and other.steps() > 2, "KeyA")
    assert not other.status["gripper_closes"]


def test_a_socket_that_is_cut_stops_the_arm_within_two_steps(page, connect):
    watcher = connect()
    page.say({"kind": "take over"})
    page.begin()
    page.until(lambda: page.steps() >= 5, "KeyA")
    page._socket.close()
    steps = page.steps()
    watcher.until(lambda: watcher.status.get("phase") == "paused", silent=True)
    seen = len(watcher.frames)
    watcher.until(lambda: len(watcher.frames) > seen + 10, silent=True)
    # One step may have been under way, and one more have been made before the end was noticed.
    assert watcher.steps() <= steps + STANDING_STEPS + 2
    assert not watcher.status["is_driven"]


def test_a_server_that_stalls_for_two_seconds_stops_the_arm_and_goes_on_afterwards(page, client):
    page.begin()
    page.until(lambda: page.steps() >= 5, "KeyA")
    steps = page.steps()

    async def stall() -> None:
        time.sleep(2)

    client.portal.call(stall)
    page.until(lambda: page.status["phase"] == "paused", silent=True)
    # Silence is noticed after a quarter of a second.
    assert page.steps() <= steps + STANDING_STEPS + 4
    page.until(lambda: page.status["phase"] == "recording", "KeyA")


def test_a_page_that_comes_back_finds_its_episode(page, connect):
    page.begin()
    page.until(lambda: page.steps() >= 5, "KeyA")
    page._socket.close()
    again = connect()
    again.until(lambda: again.status.get("drives", False) and "step" in again.status, silent=True)
    assert again.steps() >= 5


def test_an_interrupted_episode_is_offered_and_gone_on_with(page):
    page.begin()
    page.until(lambda: page.steps() >= 12, "KeyA")
    page.say({"kind": "end"})
    page.until(lambda: not page.status["going_on"] and page.status["drafts"] != [], silent=True)
    (draft,) = page.status["drafts"]
    assert (draft["task"], draft["operator"]) == ("one_leg", "Anna")
    page.say({"kind": "resume", "task": "one_leg", "draft": draft["draft"]})
    page.until(lambda: page.status["going_on"], silent=True)
    assert "interrupted" in page.status["sentence"]
    assert page.steps() >= 12


def test_an_interrupted_episode_that_nobody_wants_is_removed(page):
    page.begin()
    page.until(lambda: page.steps() >= 5, "KeyA")
    page.say({"kind": "end"})
    page.until(lambda: not page.status["going_on"] and page.status["drafts"] != [], silent=True)
    page.say({"kind": "forget", "task": "one_leg", "draft": page.status["drafts"][0]["draft"]})
    page.until(lambda: page.status["drafts"] == [], silent=True)


@pytest.fixture
def left(tmp_path) -> Callable[..., Path]:
    """Makes an interrupted episode, or something in its place, of so many seconds ago."""

    def make(task: str, name: str, age_s: float, content: bytes | None = None, **facts: object) -> Path:
        folder = tmp_path / "teleoperation" / task / "drafts"
        env = AssemblyEnv(task)
        env.reset(seed=SEEDS[0])
        begun = {"task": task, "randomness": "low", "seed": SEEDS[0], "began": "2026-11-26T14:03:00+01:00", **facts}
        draft = Draft(folder, Beginning(**begun), env.get_state())
        draft.add(np.append(env.observation()["proprioception"][:9], -1.0), idle=False, before=env.get_state())
        draft.close()
        path = folder / f"{name}.draft"
        (folder / f"{draft.name}.draft").rename(path)
        if content is not None:
            path.write_bytes(content)
        os.utime(path, (time.time() - age_s,) * 2)
        return path

    return make


def test_the_latest_interrupted_episode_is_offered_whatever_older_ones_there_are_of_other_tasks(connect, left):
    for number in range(MOST_DRAFTS):
        left("lamp", f"{number}", 1000 + number)
    left("one_leg", "latest", 10)
    page = connect()
    page.until(lambda: "drafts" in page.status, silent=True)
    offered = [(draft["task"], draft["draft"]) for draft in page.status["drafts"]]
    assert offered == [("one_leg", "latest.draft"), *(("lamp", f"{number}.draft") for number in range(MOST_DRAFTS - 1))]


def test_an_interrupted_episode_that_cannot_be_gone_on_with_says_why_and_can_be_removed(connect, left):
    path = left("one_leg", "damaged", 10, b"nonsense\n")
    left("one_leg", "another", 20)
    page = connect()
    page.until(lambda: "drafts" in page.status, silent=True)
    damaged, another = page.status["drafts"]
    assert "is damaged from its first line on; remove it" in damaged["problem"]
    assert another["problem"] == ""
    page.say({"kind": "forget", "task": "one_leg", "draft": damaged["draft"]})
    page.until(lambda: len(page.status["drafts"]) == 1, silent=True)
    assert not path.exists()


def test_an_interrupted_episode_on_a_disk_that_became_read_only_says_so_and_not_that_somebody_removed_it(
    connect, left, monkeypatch
):
    path = left("one_leg", "stuck", 10)
    page = connect()
    page.until(lambda: "drafts" in page.status, silent=True)
    assert page.status["drafts"][0]["problem"] == ""
    opened = os.open

    def refuse(file, flags, *more, **named):
        if os.fspath(file) == str(path) and flags & os.O_RDWR:
            raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(path))
        return opened(file, flags, *more, **named)

    monkeypatch.setattr(os, "open", refuse)
    page.say({"kind": "resume", "task": "one_leg", "draft": path.name})
    page.until(lambda: len(page.refusals) == 1, silent=True)
    another = connect()
    another.until(lambda: "drafts" in another.status, silent=True)
    for sentence in (page.refusals[0], *(draft["problem"] for draft in another.status["drafts"])):
        assert f"draft '{path}', as it cannot be written (Read-only file system); mount its disk" in sentence
    assert len(another.status["drafts"]) == 1


def test_on_a_read_only_disk_whoever_removes_or_begins_an_episode_is_told_how_to_mend_it(page, left, monkeypatch):
    path = left("one_leg", "stuck", 10)
    page.until(lambda: "drafts" in page.status, silent=True)

    def refuse(file, *more, **named):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(file))

    for name in ("unlink", "touch", "mkdir"):
        monkeypatch.setattr(Path, name, refuse)
    page.say({"kind": "forget", "task": "one_leg", "draft": path.name})
    page.until(lambda: len(page.refusals) == 1, silent=True)
    page.say({"kind": "begin", "task": "one_leg", "operator": "Anna", "target": 3})
    page.until(lambda: len(page.refusals) == 2, silent=True)
    assert f"draft '{path}' cannot be removed: the file system is read-only; mount it" in page.refusals[0]
    assert "cannot be written: the file system is read-only; mount it" in page.refusals[1]


def test_an_interrupted_episode_whose_key_map_is_gone_goes_on_with_the_keys_of_the_form(page, left):
    left("one_leg", "mine", 10, keys="mine.toml", operator="Anna")
    order = {"kind": "resume", "task": "one_leg", "draft": "mine.draft"}
    page.say(order)
    page.until(lambda: len(page.refusals) == 1, silent=True)
    assert "no key map 'mine.toml'" in page.refusals[0]
    page.say({**order, "keys": "isaaclab", "operator": "Ben"})
    page.until(lambda: page.status.get("step") == 1, silent=True)
    assert (page.status["keys"], page.status["operator"]) == ("isaaclab", "Ben")


def test_nothing_is_offered_of_an_episode_that_was_taken_back_to_its_beginning(page):
    page.begin()
    page.until(lambda: page.steps() >= 3, "KeyA")
    page.press("KeyB")
    page.until(lambda: page.steps() == 0)
    page.say({"kind": "end"})
    page.until(lambda: not page.status["going_on"], silent=True)
    assert page.status["drafts"] == []


def test_numbers_are_told_to_whoever_asks(page):
    page.begin()
    assert "numbers" not in page.status
    page.say({"kind": "numbers"})
    page.until(lambda: "numbers" in page.status, silent=True)
    assert len(page.status["numbers"]["proprioception"]) == 16


@pytest.mark.parametrize("headers", [{}, {"cookie": "juicer=wrong"}])
def test_whoever_does_not_know_the_token_gets_no_socket(application, headers):
    stranger = TestClient(Access(application, TOKEN))
    with pytest.raises(WebSocketDisconnect), stranger.websocket_connect("/teleop/live", headers=headers):
        pass


@pytest.mark.parametrize("headers", [{"origin": "http://evil.example"}, {"host": "evil.example"}])
def test_other_web_pages_get_no_socket(application, headers):
    guarded = TestClient(Guard(application, {"127.0.0.1:8000"}), base_url="http://127.0.0.1:8000")
    with pytest.raises(WebSocketDisconnect), guarded.websocket_connect("/teleop/live", headers=headers):
        pass


def test_of_two_pages_that_begin_at_once_one_is_told_that_the_other_drives(connect):
    pages = [connect(), connect()]
    for page in pages:
        page.say({"kind": "begin", "task": "one_leg"})
    for page in pages:
        page.until(lambda page=page: page.status.get("going_on", False) or page.refusals, silent=True)
    pages[1].until(lambda: len(pages[1].refusals) == 1 or not pages[0].status["going_on"], silent=True)
    assert [len(page.refusals) for page in pages] == [0, 1]
