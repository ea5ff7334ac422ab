"""An episode in a real browser is gone through by keys, step by step, within the content policy."""

from __future__ import annotations

import pytest

from benchmarks.page.chromium import CHROMIUM, Chromium

PLAY = "document.querySelector('#play')"
SHOWN = "document.querySelector('#where').textContent"


@pytest.fixture
def browser(tmp_path):
    browser = Chromium(tmp_path / "profile")
    yield browser
    browser.close()


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
def test_page_keys_lead_past_an_episode_of_which_only_the_outcome_was_kept(address, browser, run):
    browser.open(f"{address}/episodes?artifact={run.evaluation}&episode=1")
    assert browser.evaluate("document.querySelector('#frames') === null")
    for key, shown in (("PageUp", 0), ("PageDown", 1)):
        browser.evaluate(f"document.body.dispatchEvent(new KeyboardEvent('keydown', {{code: '{key}', bubbles: true}}))")
        browser.until(f"location.search.includes('episode={shown}') && document.readyState === 'complete'")


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
@pytest.mark.usefixtures("drawing")
def test_keys_go_through_an_episode_and_its_address_follows(address, browser, run):
    browser.open(f"{address}/episodes?artifact={run.episodes}&episode=0&frame=3")
    browser.until(f"{SHOWN}.startsWith('step 3 of')")
    for key, shift, shown in (("ArrowRight", "false", 4), ("ArrowRight", "true", 14), ("ArrowLeft", "false", 13)):
        browser.evaluate(
            f"document.body.dispatchEvent(new KeyboardEvent('keydown', "
            f"{{code: '{key}', shiftKey: {shift}, bubbles: true}}))"
        )
        assert browser.evaluate(SHOWN).startswith(f"step {shown} of")
    browser.until("location.search.endsWith('frame=13')")
    # The screen is drawn, and the strip below it is there.
    browser.until("document.querySelectorAll('#strip canvas').length > 5")
    pixel = "document.querySelector('#screen').getContext('2d').getImageData(100, 100, 1, 1).data[3]"
    browser.until(f"{pixel} === 255")


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
@pytest.mark.usefixtures("drawing")
def test_playing_stops_with_a_remedy_when_no_image_comes_and_goes_on_when_they_come_again(address, browser, run):
    browser.call("Network.setBlockedURLs", urls=["*/episodes/sheet.jpg*"])
    browser.open(f"{address}/episodes?artifact={run.episodes}&episode=0&frame=3")
    browser.until(f"{SHOWN}.startsWith('The server does not answer; start `juicer pages` again')", 20)
    browser.evaluate(f"{PLAY}.click()")
    browser.until(f"{PLAY}.textContent === 'Play' && {PLAY}.getAttribute('aria-pressed') === 'false'", 20)
    assert "juicer pages" in browser.evaluate(SHOWN)
    browser.call("Network.setBlockedURLs", urls=[])
    browser.evaluate(f"{PLAY}.click()")
    browser.until("Number(document.querySelector('#position').value) > 3", 20)
    assert browser.evaluate(SHOWN).startswith("step ")
    browser.evaluate(f"{PLAY}.textContent === 'Pause' && {PLAY}.click()")
    browser.until("document.querySelectorAll('#strip canvas').length > 5", 20)


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
@pytest.mark.usefixtures("drawing")
def test_image_of_the_step_shown_is_told_to_screen_readers(address, browser, run):
    browser.open(f"{address}/episodes?artifact={run.episodes}&episode=0&frame=3")
    browser.until("document.querySelectorAll('#strip canvas').length > 5")
    current = "[...document.querySelectorAll('#strip [aria-current]')].map((each) => each.getAttribute('aria-current'))"
    browser.until(f"({current}).length === 1")
    assert browser.evaluate(current) == ["step"]


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
@pytest.mark.usefixtures("drawing")
def test_playing_from_the_end_begins_at_the_first_step(address, browser, run, insertions):
    browser.open(f"{address}/episodes?artifact={run.episodes}&episode=0&frame={len(insertions[0])}")
    browser.until(f"{SHOWN}.startsWith('end')")
    browser.evaluate(f"{PLAY}.click()")
    assert browser.evaluate(SHOWN).startswith("step ")
