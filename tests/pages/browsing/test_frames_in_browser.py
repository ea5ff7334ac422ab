"""An episode in a real browser is gone through by keys, step by step, within the content policy."""

from __future__ import annotations

import threading
import time

import pytest
import uvicorn

from flows.servers.addresses import listen_on, port_of
from juicer.pages.application import create_application
from juicer.pages.workplace import Workplace
from tests.flows.servers.test_browser import CHROMIUM, Browser

SHOWN = "document.querySelector('#where').textContent"


@pytest.fixture
def address(run, tmp_path):
    with listen_on("127.0.0.1", 0) as listener:
        application = create_application(Workplace(run.store, tmp_path))
        server = uvicorn.Server(uvicorn.Config(application, log_level="error"))
        thread = threading.Thread(target=server.run, args=([listener],))
        thread.start()
        yield f"http://127.0.0.1:{port_of(listener)}"
        server.should_exit = True
        thread.join()


@pytest.fixture
def browser(tmp_path):
    browser = Browser(tmp_path / "profile")
    yield browser
    browser.close()


def await_true(browser, condition):
    while not browser.run(condition):
        time.sleep(0.05)


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
@pytest.mark.usefixtures("drawing")
def test_keys_go_through_an_episode_and_its_address_follows(address, browser, run):
    browser.open(f"{address}/episodes?artifact={run.episodes}&episode=0&frame=3")
    await_true(browser, f"{SHOWN}.startsWith('step 3 of')")
    for key, shift, shown in (("ArrowRight", "false", 4), ("ArrowRight", "true", 14), ("ArrowLeft", "false", 13)):
        browser.run(
            f"document.body.dispatchEvent(new KeyboardEvent('keydown', "
            f"{{code: '{key}', shiftKey: {shift}, bubbles: true}}))"
        )
        assert browser.run(SHOWN).startswith(f"step {shown} of")
    await_true(browser, "location.search.endsWith('frame=13')")
    # The screen is drawn, and the strip below it is there.
    await_true(browser, "document.querySelectorAll('#strip canvas').length > 5")
    pixel = "document.querySelector('#screen').getContext('2d').getImageData(100, 100, 1, 1).data[3]"
    await_true(browser, f"{pixel} === 255")
