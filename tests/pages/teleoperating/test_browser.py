"""A scripted pair of hands at a real page, by real key events over the real socket, in headless Chromium."""

from __future__ import annotations

import json
import os
import time

import pytest

from benchmarks.page.chromium import CHROMIUM, Chromium
from benchmarks.page.driving import COUNT_PAUSES, begin, drive
from benchmarks.page.hands import Hands
from benchmarks.page.server import serving
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
        assert browser.evaluate("document.querySelector('#sound').checked")
        x, y = browser.evaluate(
            "(() => { const button = document.querySelector('#actions button'); button.scrollIntoView();"
            " const {x, y} = button.getBoundingClientRect(); return [x + 5, y + 5]; })()"
        )
        for kind in ("mousePressed", "mouseReleased"):
            browser.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)
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
        browser.evaluate(
            "window.pad = {connected: true, mapping: 'standard', axes: [0, 0, 0, 0],"
            " buttons: Array.from({length: 17}, (_, index) => ({pressed: index === 1, value: 0}))};"
            "navigator.getGamepads = () => [window.pad]"
        )
        time.sleep(0.5)
        assert shown(browser, "seed") == 500000
        assert shown(browser, "step") >= 5
        browser.evaluate("pad.buttons[1].pressed = false")
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
        browser.until("teleop.status.phase === 'paused' || teleop.status.phase === 'idle'")
        acted = shown(browser, "acted")
        time.sleep(1)
        assert shown(browser, "acted") == acted
        # The keys drive on.
        browser.hold({"KeyW"}, set())
        browser.until(f"teleop.status.acted > {acted}")
