"""Hands at a real page: they look at what it shows, and press its keys."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass

import numpy as np

from benchmarks.page.chromium import Chromium
from benchmarks.page.hands import DISCARD, GRIPPER, UNDO, Hands

SEEN = ("numbers", "gripper_closes", "step", "acted", "phase", "seed")
COUNT_PAUSES = """
teleop.pauses = 0;
new MutationObserver(() => { teleop.pauses += document.querySelector('#state').dataset.phase === 'paused' })
  .observe(document.querySelector('#state'), {attributes: true});
"""
"""That nothing was heard of the operator for too long is told as a pause."""
MOST_UNDOS = 3
"""Times that some seconds are taken back after a part was lost."""
LOOK = f"JSON.stringify([{', '.join(f'teleop.status.{name}' for name in SEEN)}])"


@dataclass(frozen=True)
class Driven:
    """What became of one initial state.

    Attributes:
        seed: Of the initial state.
        success: Whether it was assembled, and saved.
        seconds: How long it took.
        steps: Control steps.
        acted: Of these, the ones in which the hands wanted something.
        presses: Of keys.
        undos: Times that some seconds were taken back.
    """

    seed: int
    success: bool
    seconds: float
    steps: int
    acted: int
    presses: int
    undos: int


def begin(browser: Chromium, address: str, task: str = "one_leg") -> None:
    """Open the page and begin, with the mouse where a person would use it."""
    browser.open(address)
    browser.until("document.querySelector('select[name=task]')?.options.length && 'going_on' in teleop.status")
    browser.evaluate(
        f"document.querySelector('select[name=task]').value = '{task}';"
        "document.querySelector('#begin input[name=operator]').value = 'scripted hands';"
        "document.querySelector('#begin button').click()"
    )
    browser.until("teleop.status.going_on && teleop.status.numbers && teleop.figures.framesPerSecond > 0")


def drive(browser: Chromium, hands: Hands, most_seconds: float) -> Driven:
    """Drive until the episode ends, or time runs out; what is not a success is discarded, and the next one begins."""
    held: set[str] = set()
    seen, presses, undos, began = -1, 0, 0, time.monotonic()
    while True:
        numbers, closes, step, acted, phase, seed = json.loads(browser.evaluate(LOOK))
        seconds = time.monotonic() - began
        success = phase == "over" and browser.evaluate(f"teleop.status.kept[0]?.name.startsWith('{seed:08d}') ?? false")
        if success or seconds > most_seconds or (phase == "over" and undos == MOST_UNDOS):
            break
        if phase == "over":
            held, undos = browser.hold((), held), undos + 1
            browser.press(UNDO)
            browser.until("teleop.status.phase !== 'over'")
            hands.begin_anew()
        elif step != seen or not held:
            seen = step
            keys = hands.look({name: np.array(values, np.float32) for name, values in numbers.items()}, closes)
            presses += len(keys.held - held) + keys.toggles
            held = browser.hold(keys.held, held)
            if keys.toggles:
                browser.press(GRIPPER)
        time.sleep(0.005)
    browser.hold((), held)
    if not success:
        browser.press(DISCARD)
    browser.until("teleop.status.step === 0")  # the next one is there
    return Driven(seed, success, seconds, step, acted, presses, undos)
