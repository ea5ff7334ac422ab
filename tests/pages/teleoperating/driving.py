"""Hands at a real page: they look at what it shows, and press its keys."""

from __future__ import annotations

import json
import time

import numpy as np

from tests.pages.teleoperating.chromium import Chromium
from tests.teleoperation.hands import GRIPPER, Hands

SEEN = ("numbers", "gripper_closes", "step", "phase", "kept")
LOOK = f"JSON.stringify([{', '.join(f'teleop.status.{name}' for name in SEEN)}])"


def begin(browser: Chromium, address: str, task: str = "one_leg") -> None:
    """Open the page and begin, with the mouse where a person would use it."""
    browser.goto(address)
    browser.until("document.querySelector('select[name=task]').options.length && 'going_on' in teleop.status")
    browser.evaluate(
        f"document.querySelector('select[name=task]').value = '{task}';"
        "document.querySelector('input[name=operator]').value = 'scripted hands';"
        "document.querySelector('#begin button').click()"
    )
    browser.until("teleop.status.going_on && teleop.status.numbers && teleop.figures.framesPerSecond > 0")


def drive(browser: Chromium, hands: Hands, seconds: float) -> int:
    """Drive until an episode ends as a success; the number of its steps, or -1 if time runs out."""
    held: set[str] = set()
    seen, end = -1, time.monotonic() + seconds
    before = json.loads(browser.evaluate(LOOK))[4]
    while time.monotonic() < end:
        numbers, closes, step, phase, kept = json.loads(browser.evaluate(LOOK))
        if len(kept) != len(before) or phase == "over":
            browser.hold((), held)
            return step
        if step != seen or not held:
            seen = step
            keys = hands.look({name: np.array(values, np.float32) for name, values in numbers.items()}, closes)
            held = browser.hold(keys.held, held)
            if keys.toggles:
                browser.press(GRIPPER)
        time.sleep(0.005)
    browser.hold((), held)
    return -1
