"""A scripted pair of hands at a real page, by real key events over the real socket, in headless Chromium."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path

import pytest

from benchmarks.page.chromium import CHROMIUM, Chromium
from benchmarks.page.driving import COUNT_PAUSES, begin, drive
from benchmarks.page.hands import Hands
from benchmarks.page.server import Server, serving
from benchmarks.page.slow_line import SlowLine
from juicer.artifacts.recipe import Recipe
from juicer.artifacts.store import ArtifactStore
from juicer.demonstration.ingestion import Demonstration, IngestionConfig, ingest
from juicer.demonstration.log import read_log
from juicer.episode import Source
from juicer.storage.episodes import write_episodes
from tests.pages.conftest import commit
from tests.teleoperation.rollouts import stuck_rollout

pytestmark = [pytest.mark.slow, pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed")]

ATTEMPTS, SECONDS = 6, 200


@pytest.fixture
def browser(tmp_path):
    with Chromium(tmp_path / "profile") as browser:
        yield browser


def shown(browser: Chromium, name: str) -> object:
    return json.loads(browser.evaluate(f"JSON.stringify(teleop.status.{name} ?? null)"))


def press_mouse(browser: Chromium, selector: str) -> None:
    """Press the mouse on an element."""
    press_mouse_at(browser, *place_of(browser, selector))


def place_of(browser: Chromium, selector: str) -> tuple[float, float]:
    """A place on an element that is scrolled into view."""
    x, y = browser.evaluate(
        f"(() => {{ const place = document.querySelector({json.dumps(selector)}); place.scrollIntoView();"
        " const {x, y} = place.getBoundingClientRect(); return [x + 5, y + 5]; })()"
    )
    return x, y


def press_mouse_at(browser: Chromium, x: float, y: float, count: int = 1) -> None:
    """Press the mouse at a place, the `count`-th time in a row."""
    for kind in ("mousePressed", "mouseReleased"):
        browser.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=count)


CATCH_SOCKETS = """
window.sockets = [];
window.WebSocket = class extends WebSocket {
  constructor(...about) { super(...about); window.sockets.push(this); }
};
"""
"""Lets a test end a connection of the page, or say something over it that the page would not say."""


def catch_sockets(browser: Chromium) -> None:
    browser.call("Page.addScriptToEvaluateOnNewDocument", source=CATCH_SOCKETS)


def connect_again(browser: Chromium) -> None:
    """End the connection, and wait until the page was greeted and told the status anew."""
    browser.evaluate("sockets.at(-1).close()")
    browser.until("!('going_on' in teleop.status)")
    browser.until("'going_on' in teleop.status")


def problem_of(browser: Chromium) -> str:
    return browser.evaluate("document.querySelector('#problem:not([hidden])')?.innerText ?? ''")


@pytest.mark.timeout(1500)
def test_hands_drive_one_leg_to_a_success_that_is_saved_and_ingested(tmp_path, browser):
    with serving(tmp_path) as server:
        begin(browser, server.teleop)
        for attempt in range(ATTEMPTS):
            if drive(browser, Hands("one_leg", attempt), SECONDS).success:
                break
        browser.until("teleop.status.kept[0].verification.verdict !== 'checking'", 120)
        assert shown(browser, "kept[0].verification.verdict") == "verified", shown(browser, "kept")
        assert (shown(browser, "demonstrations"), shown(browser, "corrections")) == (1, 0)
        assert browser.evaluate("document.querySelector('#demonstrations').textContent") == "1"
    (path,) = (tmp_path / "teleoperation" / "one_leg").glob("*.npz")
    (demonstration,) = ingest([path], IngestionConfig(task="one_leg"))
    assert isinstance(demonstration, Demonstration)
    assert demonstration.episode.record.operator == "scripted hands"
    assert demonstration.episode.record.device.startswith("keyboard, keys original")
    assert len(read_log(path)) == demonstration.num_steps


def test_a_killed_server_loses_nothing_of_the_episode_in_hand_and_offers_it(tmp_path, browser):
    with serving(tmp_path) as server:
        begin(browser, server.teleop)
        browser.key_down("KeyA")
        browser.until("teleop.status.step >= 15")
        steps = shown(browser, "step")
        server.kill()
        browser.key_up("KeyA")
        browser.until("!document.querySelector('#problem').hidden")
    with serving(tmp_path) as server:
        browser.open(server.teleop)
        browser.until("!document.querySelector('#drafts').hidden")
        browser.evaluate("document.querySelector('#draft-list button').click()")
        browser.until("teleop.status.going_on && teleop.status.step > 0")
        assert shown(browser, "step") >= steps
        browser.until("document.querySelector('#sentence').textContent.includes('interrupted')")


REMOVAL = "#draft-list li:nth-child({}) button:last-of-type"


@pytest.fixture
def interrupted(tmp_path) -> Path:
    """The folder of three interrupted episodes, which can only be removed."""
    folder = tmp_path / "teleoperation" / "one_leg" / "drafts"
    folder.mkdir(parents=True)
    for age_s in range(3):
        path = folder / f"of_{age_s}_s_ago.draft"
        path.write_text("nonsense")
        os.utime(path, (time.time() - age_s,) * 2)
    return folder


def open_interrupted(browser: Chromium, server: Server) -> None:
    browser.open(server.teleop)
    browser.until("document.querySelectorAll('#draft-list li').length === 3")


def text_of(browser: Chromium, selector: str) -> str:
    return browser.evaluate(f"document.querySelector({json.dumps(selector)}).innerText")


def test_a_double_click_removes_no_interrupted_episode_and_a_further_click_only_that_one(
    tmp_path, browser, interrupted
):
    with serving(tmp_path) as server:
        open_interrupted(browser, server)
        x, y = place_of(browser, REMOVAL.format(1))
        press_mouse_at(browser, x, y)
        time.sleep(0.2)
        press_mouse_at(browser, x, y, 2)
        time.sleep(1)
        assert len(list(interrupted.iterdir())) == 3
        assert text_of(browser, REMOVAL.format(1)) == "Really remove it"
        assert text_of(browser, REMOVAL.format(2)) == "Remove it"
        press_mouse_at(browser, x, y)
        browser.until("document.querySelectorAll('#draft-list li').length === 2")
        press_mouse_at(browser, x, y, 2)
        time.sleep(1)
        assert sorted(path.name for path in interrupted.iterdir()) == ["of_1_s_ago.draft", "of_2_s_ago.draft"]


def test_the_question_whether_to_remove_an_interrupted_episode_goes_away_with_the_focus_or_by_itself(
    tmp_path, browser, interrupted
):
    with serving(tmp_path) as server:
        open_interrupted(browser, server)
        press_mouse(browser, REMOVAL.format(1))
        assert text_of(browser, REMOVAL.format(1)) == "Really remove it"
        browser.press("Tab")
        assert text_of(browser, REMOVAL.format(1)) == "Remove it"
        press_mouse(browser, REMOVAL.format(2))
        browser.until(f"document.querySelector('{REMOVAL.format(2)}').innerText === 'Remove it'", 20)
        assert len(list(interrupted.iterdir())) == 3


def test_who_removes_interrupted_episodes_with_the_keyboard_keeps_their_place(tmp_path, browser, interrupted):
    with serving(tmp_path) as server:
        open_interrupted(browser, server)
        browser.evaluate(
            "window.rows = [...document.querySelectorAll('#draft-list li')];"
            f"document.querySelector('{REMOVAL.format(1)}').focus()"
        )
        for left in (2, 1):
            browser.press("Enter")
            time.sleep(0.6)
            assert len(list(interrupted.iterdir())) == left + 1
            browser.press("Enter")
            assert browser.evaluate("document.activeElement !== document.body")
            browser.until(f"document.querySelectorAll('#draft-list li').length === {left}")
            assert browser.evaluate(f"document.activeElement === document.querySelector('{REMOVAL.format(1)}')")
            assert browser.evaluate(
                "[...document.querySelectorAll('#draft-list li')].every((row) => rows.includes(row))"
            )
        browser.press("Enter")
        time.sleep(0.6)
        browser.press("Enter")
        browser.until("document.querySelector('#drafts').hidden")
        assert browser.evaluate("document.activeElement.id") == "setup-title"


def test_an_interrupted_episode_that_somebody_else_has_removed_can_be_pressed_again(tmp_path, browser, interrupted):
    with serving(tmp_path) as server:
        open_interrupted(browser, server)
        press_mouse(browser, REMOVAL.format(1))
        time.sleep(0.6)
        (interrupted / "of_0_s_ago.draft").unlink()
        press_mouse(browser, REMOVAL.format(1))
        browser.until("document.querySelector('#problem').innerText.includes('no longer there')")
        assert not browser.evaluate(f"document.querySelector('{REMOVAL.format(1)}').disabled")


CHOSEN = {"operator": "Ben", "target": "7", "task": "lamp", "randomness": "med", "keys": "isaaclab"}


def chosen(browser: Chromium) -> dict[str, str]:
    return json.loads(
        browser.evaluate(
            f"JSON.stringify(Object.fromEntries({list(CHOSEN)}.map((name) =>"
            " [name, document.querySelector('#begin').elements[name].value])))"
        )
    )


def choose(browser: Chromium, **values: str) -> None:
    for name, value in values.items():
        browser.evaluate(f"document.querySelector('#begin').elements.{name}.value = '{value}'")


def test_what_was_chosen_stays_chosen_when_the_page_connects_again(tmp_path, browser):
    own = tmp_path / "teleoperation" / "mine.toml"
    own.parent.mkdir()
    own.write_text('base = "isaaclab"\n')
    catch_sockets(browser)
    with serving(tmp_path) as server:
        browser.open(server.teleop)
        browser.until("'going_on' in teleop.status")
        browser.evaluate(
            "localStorage.setItem('teleop.operator', 'Anna'); localStorage.setItem('teleop.task', 'round_table')"
        )
        browser.open(server.teleop)
        browser.until("'going_on' in teleop.status")
        assert (chosen(browser)["operator"], chosen(browser)["task"]) == ("Anna", "round_table")
        choose(browser, **CHOSEN)
        browser.evaluate("document.querySelector('#take-over').operator.value = 'Cleo'")
        connect_again(browser)
        assert chosen(browser) == CHOSEN
        assert browser.evaluate("document.querySelector('#take-over').operator.value") == "Cleo"
        choose(browser, keys="mine.toml")
        connect_again(browser)
        assert chosen(browser) == CHOSEN | {"keys": "mine.toml"}
        own.unlink()
        connect_again(browser)
        assert chosen(browser) == CHOSEN | {"keys": "original"}, "what is no longer offered cannot be chosen"


def refuse(browser: Chromium) -> None:
    """Say what the server refuses, over the page's connection."""
    browser.evaluate("sockets.at(-1).send(JSON.stringify({kind: 'begin', task: 'rocket'}))")
    browser.until("document.querySelector('#problem').innerText.includes(\"no task 'rocket'\")")


def drive_on(browser: Chromium) -> None:
    steps = shown(browser, "acted")
    browser.until(f"teleop.status.acted > {steps + 5}")


def test_what_is_wrong_is_said_until_it_is_over_whatever_else_is_told_meanwhile(tmp_path, browser):
    own = tmp_path / "teleoperation" / "mine.toml"
    own.parent.mkdir()
    own.write_text('base = "nonsense"\n')
    catch_sockets(browser)
    with serving(tmp_path) as server:
        begin(browser, server.teleop)
        browser.key_down("KeyA")
        drive_on(browser)
        assert "mine.toml" in problem_of(browser)
        refuse(browser)
        drive_on(browser)
        assert "mine.toml" in problem_of(browser)
        assert "There is no task 'rocket'" in problem_of(browser)
        browser.key_up("KeyA")
        browser.evaluate(
            "document.querySelector('#undo-s').value = '30';"
            "document.querySelector('#undo-s').dispatchEvent(new Event('change'))"
        )
        browser.until("!document.querySelector('#problem').innerText.includes('rocket')")
        refuse(browser)
        browser.press("Space")
        browser.until("!document.querySelector('#problem').innerText.includes('rocket')")
        assert "mine.toml" in problem_of(browser)
        browser.evaluate("sockets.at(-1).close()")
        browser.until("document.querySelector('#problem').innerText.includes('connects again by itself')")
        browser.until("teleop.status.going_on")
        assert "connects again" not in problem_of(browser)
        assert "mine.toml" in problem_of(browser)
        own.unlink()
        connect_again(browser)
        assert problem_of(browser) == ""


def test_a_refusal_is_gone_once_something_is_begun_or_ended(tmp_path, browser):
    catch_sockets(browser)
    with serving(tmp_path) as server:
        browser.open(server.teleop)
        browser.until("document.querySelector('select[name=task]')?.options.length && 'going_on' in teleop.status")
        refuse(browser)
        browser.evaluate("document.querySelector('#begin button').click()")
        browser.until("teleop.status.going_on && teleop.figures.framesPerSecond > 0")
        assert problem_of(browser) == ""
        refuse(browser)
        browser.evaluate("document.querySelector('#end').click()")
        browser.until("!teleop.status.going_on")
        assert problem_of(browser) == ""


@pytest.mark.timeout(1500)
def test_a_rollout_is_finished_by_hand_from_its_page_though_the_server_is_killed_meanwhile(tmp_path, browser):
    stuck = stuck_rollout()
    step, store = len(stuck) - 5, ArtifactStore(tmp_path)
    ref = commit(store, Recipe("collect", "episodes"), {}, lambda folder: write_episodes(folder, [stuck], {}))
    with serving(tmp_path) as server:
        browser.open(f"{server.address}/episodes?artifact={ref}&episode=0&frame={step - 1}&token={server.token}")
        browser.open(f"{server.address}/episodes?artifact={ref}&episode=0&frame={step - 1}")
        browser.until("document.querySelector('#where').textContent.startsWith('step')")
        browser.press("ArrowRight")
        browser.until(f"document.querySelector('#correct').href.endsWith('frame={step}')")
        browser.evaluate("document.querySelector('#correct').click()")
        browser.until("location.pathname === '/teleop' && document.querySelector('select[name=keys]')?.options.length")
        browser.evaluate("document.querySelector('#begin button').click()")
        browser.until("teleop.status.going_on && teleop.figures.framesPerSecond > 0")
        browser.key_down("KeyE")
        browser.until("teleop.status.step >= 15")
        server.kill()
        browser.key_up("KeyE")
    with serving(tmp_path) as server:
        browser.open(server.teleop)
        browser.until("!document.querySelector('#drafts').hidden")
        assert f"from step {step} on" in browser.evaluate("document.querySelector('#draft-list').innerText")
        browser.evaluate("document.querySelector('#draft-list button').click()")
        browser.until("teleop.status.going_on && teleop.status.step > 0 && teleop.status.numbers")
        for attempt in range(ATTEMPTS):
            if drive(browser, Hands("one_leg", attempt), SECONDS).success:
                break
        browser.until("teleop.status.kept[0].verification.verdict !== 'checking'", 120)
        assert shown(browser, "kept[0].verification.verdict") == "verified", shown(browser, "kept")
        assert (shown(browser, "demonstrations"), shown(browser, "corrections")) == (0, 1)
        tally = browser.evaluate("document.querySelector('.tally').innerText")
        assert "0 of 50 demonstrations, corrections: 1" in tally
    (path,) = (tmp_path / "teleoperation" / "one_leg").glob("*.npz")
    (correction,) = ingest([path], IngestionConfig(task="one_leg"))
    assert isinstance(correction, Demonstration)
    record = correction.episode.record
    assert (record.source, record.parent, record.parent_step) == (Source.CORRECTION, stuck.record.episode_id, step)
    assert correction.episode.state(0).tobytes() == stuck.state(step).tobytes()


def test_an_episode_in_hand_is_never_taken_for_the_rollout_that_is_to_be_finished(tmp_path, browser):
    stuck = stuck_rollout()
    step, store = len(stuck) - 5, ArtifactStore(tmp_path)
    ref = commit(store, Recipe("collect", "episodes"), {}, lambda folder: write_episodes(folder, [stuck], {}))
    with serving(tmp_path) as server:
        begin(browser, server.teleop)
        browser.key_down("KeyA")
        browser.until("teleop.status.step >= 5")
        browser.key_up("KeyA")
        browser.open(f"{server.address}/teleop?artifact={ref}&episode=0&frame={step}")
        browser.until("!document.querySelector('#occupied').hidden && teleop.status.drives && teleop.status.step >= 5")
        assert not browser.evaluate("document.querySelector('#setup').hidden")
        sentence = browser.evaluate("document.querySelector('#occupied').innerText")
        assert sentence.startswith("Another episode is in hand: one_leg, state 500000:")
        assert f"ends it and goes on from step {step} of rollout {stuck.record.episode_id}" in sentence
        steps = shown(browser, "step")
        browser.evaluate("document.activeElement.blur()")
        browser.key_down("KeyA")
        time.sleep(0.5)
        browser.key_up("KeyA")
        assert shown(browser, "step") == steps, "nobody drives what the page does not show"
        browser.evaluate("document.querySelector('#begin button').click()")
        browser.until(f"teleop.status.origin === 'step {step} of rollout {stuck.record.episode_id}'")
        browser.until("!document.querySelector('#drive').hidden && document.querySelector('#setup').hidden")
        browser.open(f"{server.address}/teleop?artifact={ref}&episode=0&frame={step}")
        browser.until("!document.querySelector('#drive').hidden")
    (draft,) = (tmp_path / "teleoperation" / "one_leg" / "drafts").glob("00500000-*")
    assert len(draft.read_text().splitlines()) > 5


def test_a_rollout_is_finished_by_hand_though_another_page_drives_after_taking_over(tmp_path, browser):
    stuck = stuck_rollout()
    step, store = len(stuck) - 5, ArtifactStore(tmp_path)
    ref = commit(store, Recipe("collect", "episodes"), {}, lambda folder: write_episodes(folder, [stuck], {}))
    with serving(tmp_path) as server:
        browser.open(server.teleop)
        browser.open(f"{server.address}/teleop?artifact={ref}&episode=0&frame={step}")
        browser.until("window.teleop && 'going_on' in teleop.status")
        assert browser.evaluate("document.querySelector('#take-over').hidden")
        browser.evaluate(
            "window.other = new WebSocket(`ws://${location.host}/teleop/live`);"
            "other.onopen = () => [{kind: 'take over', operator: 'Ben'}, {kind: 'begin', task: 'lamp'}].forEach("
            "order => other.send(JSON.stringify(order)))"
        )
        browser.until("!document.querySelector('#occupied').hidden && !document.querySelector('#take-over').hidden")
        browser.evaluate("document.querySelector('#begin button').click()")
        browser.until("document.querySelector('#problem').innerText.includes('take them over before you begin')")
        assert shown(browser, "task") == "lamp"
        browser.evaluate("document.querySelector('#take-over button').click()")
        browser.until("teleop.status.drives && document.querySelector('#take-over').hidden")
        browser.evaluate("document.querySelector('#begin button').click()")
        browser.until(f"teleop.status.origin === 'step {step} of rollout {stuck.record.episode_id}'")
        browser.until("!document.querySelector('#drive').hidden")
        assert problem_of(browser) == ""


def test_a_key_that_is_held_when_the_page_loses_focus_is_let_go(tmp_path, browser):
    with serving(tmp_path) as server:
        begin(browser, server.teleop)
        browser.key_down("KeyA")
        browser.until("teleop.status.step >= 5")
        browser.evaluate("window.dispatchEvent(new Event('blur'))")
        browser.until("teleop.status.phase === 'paused'")
        time.sleep(0.5)  # the arm comes to rest
        steps = shown(browser, "step")
        time.sleep(1)
        assert shown(browser, "step") == steps
        assert browser.evaluate("document.querySelector('#phase').textContent") == "Paused"


def sentence_of(browser: Chromium) -> str:
    return browser.evaluate("document.querySelector('#sentence').textContent")


def test_whoever_watches_reads_whether_somebody_drives_and_has_no_controls_that_do_nothing(tmp_path, browser):
    with serving(tmp_path) as server:
        begin(browser, server.teleop)
        browser.evaluate(
            "window.other = new WebSocket(`ws://${location.host}/teleop/live`);"
            "other.onopen = () => other.send(JSON.stringify({kind: 'take over', operator: 'Ben'}))"
        )
        browser.until("document.querySelector('#steering').disabled")
        assert sentence_of(browser).startswith("Somebody else drives")
        assert not browser.evaluate("document.querySelector('#sound').matches(':disabled')")
        browser.evaluate("other.close()")
        browser.until("document.querySelector('#sentence').textContent.startsWith('Nobody drives')")
        browser.evaluate("document.querySelector('#take-over button').click()")
        browser.until("!document.querySelector('#steering').disabled")
        browser.until("teleop.status.operator === 'scripted hands'")
        browser.key_down("KeyA")
        browser.until("teleop.status.step >= 3")
        browser.key_up("KeyA")


def test_who_is_given_the_controls_unasked_is_named(tmp_path, browser):
    with serving(tmp_path) as server:
        begin(browser, server.teleop)
        assert browser.evaluate("document.querySelector('#take-over').hidden")
        browser.evaluate("localStorage.setItem('teleop.operator', 'Bob')")
        browser.open(server.teleop)
        browser.until("window.teleop?.status.operator === 'Bob' && document.querySelector('#take-over').hidden")
        browser.evaluate("localStorage.removeItem('teleop.operator')")
        browser.open(server.teleop)
        browser.until("window.teleop?.status.drives && !document.querySelector('#take-over').hidden")
        assert "it is recorded as Bob's" in browser.evaluate("document.querySelector('#take-over').textContent")
        browser.evaluate(
            "document.querySelector('#take-over').operator.value = 'Cleo';"
            "document.querySelector('#take-over button').click()"
        )
        browser.until("teleop.status.operator === 'Cleo' && document.querySelector('#take-over').hidden")
        browser.open(server.teleop)
        browser.until("window.teleop?.status.drives && document.querySelector('#take-over').hidden")
        assert shown(browser, "operator") == "Cleo"


def test_a_list_that_is_used_by_keys_keeps_the_focus(tmp_path, browser):
    with serving(tmp_path) as server:
        begin(browser, server.teleop)
        browser.evaluate("document.querySelector('#time-scale').focus()")
        for scale in (0.75, 0.5):
            browser.key_down("ArrowDown")
            browser.key_up("ArrowDown")
            browser.until(f"teleop.status.time_scale === {scale}")
        assert browser.evaluate("document.activeElement.id") == "time-scale"


def test_the_lists_show_the_pace_and_the_longer_undo_that_hold(tmp_path, browser):
    with serving(tmp_path) as server:
        begin(browser, server.teleop)
        browser.evaluate(
            "document.querySelector('#undo-s').value = '30'; document.querySelector('#time-scale').value = '0.5';"
            "document.querySelector('#undo-s').dispatchEvent(new Event('change'))"
        )
        browser.until("teleop.status.undo_s === 30")
        browser.open(server.teleop)
        browser.until("document.querySelector('#time-scale').value === '0.5'")
        assert browser.evaluate("document.querySelector('#undo-s').value") == "30"


def test_space_presses_what_the_keyboard_has_chosen_and_drives_after_a_click(tmp_path, browser):
    with serving(tmp_path) as server:
        begin(browser, server.teleop)
        browser.evaluate("document.querySelector('#sound').focus()")
        browser.press("Space")
        browser.until("document.querySelector('#sound').checked")
        press_mouse(browser, "#actions button")
        browser.until("document.activeElement === document.body")
        assert not shown(browser, "gripper_closes")
        browser.press("Space")
        browser.until("teleop.status.gripper_closes")


def test_a_line_that_is_late_and_unsteady_is_no_reason_to_pause(tmp_path, browser):
    with SlowLine(40, jitter_ms=80) as line, serving(tmp_path, JUICER_ALLOWED_HOSTS=f"127.0.0.1:{line.port}") as server:
        line.lead_to(server.port)
        begin(browser, server.through(line.port).teleop)
        browser.evaluate(COUNT_PAUSES)
        for number in range(40):
            browser.key_down(key := ("KeyA", "KeyD")[number % 2])
            time.sleep(0.1)
            browser.key_up(key)
        assert browser.evaluate("teleop.pauses") == 0
        assert shown(browser, "step") > 0


def test_the_list_of_keys_is_there_and_the_question_mark_hides_it(tmp_path, browser):
    with serving(tmp_path) as server:
        begin(browser, server.teleop)
        assert "towards you" in browser.evaluate("document.querySelector('#key-list').innerText")
        browser.press("Slash")
        assert browser.evaluate("document.querySelector('#keys').hidden")


@pytest.mark.parametrize("size", [(1280, 800), (800, 600), (640, 400)])
def test_nothing_of_the_page_is_cut_off_at_its_side(tmp_path, browser, size):
    """The last size is that of 1280x800 at 200 % text."""
    with serving(tmp_path) as server:
        begin(browser, server.teleop)
        browser.resize(*size)
        browser.until(f"window.innerWidth === {size[0]}")
        assert browser.evaluate("document.documentElement.scrollWidth <= window.innerWidth")


def test_a_gamepad_drives_too(tmp_path, browser):
    with serving(tmp_path) as server:
        begin(browser, server.teleop)
        browser.evaluate(
            "window.pad = {connected: true, mapping: 'standard', axes: [0.9, 0, 0, 0],"
            " buttons: Array.from({length: 17}, () => ({pressed: false, value: 0}))};"
            "navigator.getGamepads = () => [window.pad]"
        )
        browser.until("teleop.status.step >= 5")
        assert shown(browser, "phase") == "recording"
        browser.evaluate("window.dispatchEvent(new Event('gamepaddisconnected')); navigator.getGamepads = () => []")
        browser.until("teleop.status.phase === 'paused'")


def test_the_press_that_wakes_a_gamepad_is_not_obeyed_and_the_next_one_is(tmp_path, browser):
    """A page sees a gamepad only once a button is pressed; B discards."""
    with serving(tmp_path) as server:
        begin(browser, server.teleop)
        browser.key_down("KeyA")
        browser.until("teleop.status.step >= 5")
        browser.key_up("KeyA")
        steps = -1
        while steps != (steps := shown(browser, "step")):  # the world comes to a stand
            time.sleep(1)
        # LB turns the gripper.
        browser.evaluate(
            "window.pad = {connected: true, mapping: 'standard', axes: [0, 0, 0, 0],"
            " buttons: Array.from({length: 17}, (_, index) => ({pressed: [1, 4].includes(index), value: 0}))};"
            "navigator.getGamepads = () => [window.pad]"
        )
        time.sleep(0.5)
        assert shown(browser, "seed") == 500000
        assert shown(browser, "step") == steps
        browser.evaluate("pad.buttons[1].pressed = pad.buttons[4].pressed = false")
        time.sleep(0.2)
        browser.evaluate("pad.buttons[1].pressed = true")
        browser.until("teleop.status.seed === 500001")


OVERTAKEN = """
import('/static/teleop/screen.js').then(async ({Screen}) => {
  const source = new OffscreenCanvas(640, 480), place = document.createElement('div');
  Object.assign(source.getContext('2d'), {fillStyle: '#fff'}).fillRect(0, 0, 640, 480);
  const jpeg = await (await source.convertToBlob({type: 'image/jpeg'})).arrayBuffer();
  const screen = new Screen(place, [{name: 'front', title: 'Front', width: 64, height: 48}]);
  const frames = [{number: 1, images: [jpeg]}, {number: 2, images: [null]}];
  await Promise.all(frames.map((frame) => screen.paint({heard: -1, movedBy: -1, ...frame})));
  return [...place.querySelector('canvas').getContext('2d').getImageData(32, 24, 1, 1).data];
})
"""


def test_an_image_is_shown_even_if_a_later_frame_without_it_is_here_first(tmp_path, browser):
    with serving(tmp_path) as server:
        browser.open(server.teleop)
        assert browser.evaluate(OVERTAKEN) == [255, 255, 255, 255]


SIMULATED_HIDRAW = """
import os
import time

def enumerate():
    return [{"vendor_id": 0x256F, "product_id": 0xC626, "usage_page": 1, "usage": 8, "path": b"simulated"}]

class device:
    def open_path(self, path):
        self.read_so_far = 0

    def read(self, max_length, timeout_ms):
        end = time.monotonic() + timeout_ms / 1000
        while time.monotonic() < end:
            with open(os.environ["SIMULATED_REPORTS"], "rb") as reports:
                reports.seek(self.read_so_far)
                report = reports.read(7)
            if len(report) == 7:
                self.read_so_far += 7
                return list(report)
            time.sleep(0.01)
        return []

    def close(self):
        pass
"""
"""The library as juicer uses it; a file stands for the device: reports are added to it, and it goes when unplugged."""

PUSHED_AWAY = bytes([1, 0, 0, 0xA2, 0xFE, 0, 0])


def test_a_spacemouse_drives_and_the_arm_stands_once_it_is_unplugged(tmp_path, browser):
    (tmp_path / "library").mkdir()
    (tmp_path / "library" / "hidraw.py").write_text(SIMULATED_HIDRAW)
    reports = tmp_path / "reports"
    reports.touch()
    path = os.pathsep.join([str(tmp_path / "library"), os.environ.get("PYTHONPATH", "")])
    with serving(tmp_path / "data", PYTHONPATH=path, SIMULATED_REPORTS=str(reports)) as server:
        browser.open(server.teleop)
        browser.until("document.querySelector('select[name=task]')?.options.length && 'going_on' in teleop.status")
        browser.evaluate("document.querySelector('input[name=spacemouse]').click()")
        browser.evaluate("document.querySelector('#begin button').click()")
        browser.until("teleop.status.going_on && teleop.status.spacemouse && teleop.status.numbers")
        with reports.open("ab") as file:
            file.write(PUSHED_AWAY)
        browser.until("teleop.status.acted > 5")
        reports.unlink()
        browser.until("!teleop.status.spacemouse")
        assert "the SpaceMouse was unplugged; plug it in and choose it again" in str(shown(browser, "problem"))
        assert "The SpaceMouse was unplugged" in problem_of(browser)
        browser.until("teleop.status.phase === 'paused' || teleop.status.phase === 'idle'")
        acted = shown(browser, "acted")
        time.sleep(1)
        assert shown(browser, "acted") == acted
        # The keys drive on.
        browser.hold({"KeyW"}, set())
        browser.until(f"teleop.status.acted > {acted}")
