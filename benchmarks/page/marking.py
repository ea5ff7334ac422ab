"""Somebody at the page of annotation."""

from __future__ import annotations

from benchmarks.page.chromium import Chromium
from benchmarks.page.server import Server

READY = "document.querySelector('#judging:not([hidden])')?.ariaBusy === 'false'"
"""Whether a demonstration is shown, and can be marked."""


def begin(browser: Chromium, served: Server, episodes: str, author: str = "Ada") -> None:
    """Open an artifact of episodes, and say who one is."""
    browser.open(served.annotate(episodes))
    browser.until("!document.querySelector('#judging').hidden")
    browser.evaluate("document.querySelector('#author').focus()")
    browser.type(author)
    browser.press("Enter")
