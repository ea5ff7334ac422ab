"""An episode in a real browser is gone through by keys, step by step, within the content policy."""

from __future__ import annotations

import pytest

from tests.browser import CHROMIUM, Browser

SHOWN = "document.querySelector('#where').textContent"


@pytest.fixture
def browser(tmp_path):
    browser = Browser(tmp_path / "profile")
    yield browser
    browser.close()


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
@pytest.mark.usefixtures("drawing")
def test_keys_go_through_an_episode_and_its_address_follows(address, browser, run):
    browser.open(f"{address}/episodes?artifact={run.episodes}&episode=0&frame=3")
    browser.wait(f"{SHOWN}.startsWith('step 3 of')")
    for key, shift, shown in (("ArrowRight", "false", 4), ("ArrowRight", "true", 14), ("ArrowLeft", "false", 13)):
        browser.run(
            f"document.body.dispatchEvent(new KeyboardEvent('keydown', "
            f"{{code: '{key}', shiftKey: {shift}, bubbles: true}}))"
        )
        assert browser.run(SHOWN).startswith(f"step {shown} of")
    browser.wait("location.search.endsWith('frame=13')")
    # The screen is drawn, and the strip below it is there.
    browser.wait("document.querySelectorAll('#strip canvas').length > 5")
    pixel = "document.querySelector('#screen').getContext('2d').getImageData(100, 100, 1, 1).data[3]"
    browser.wait(f"{pixel} === 255")
