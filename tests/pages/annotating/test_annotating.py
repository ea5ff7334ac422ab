"""Fifty demonstrations are annotated in a real browser, by real keys, in less time than the paper's people took."""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from benchmarks.page.chromium import CHROMIUM, Chromium
from benchmarks.page.marking import READY, begin
from benchmarks.page.server import Server, serving
from juicer.annotation.measures import measure
from juicer.annotation.standing import agreed_labels
from juicer.annotation.versions import Entry, read_versions, save
from juicer.reporting.paper import PAPER_TABLE_IV
from tests.pages.annotating.conftest import RIGHT_STEP

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium on this machine"),
]

OFF = (10,) * 5 + (-1,) * 2 + (-11,) * 3
"""By how much ten proposals are wrong."""


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Server]:
    with serving(tmp_path / "data", JUICER_WORKERS="1") as server:
        yield server


@pytest.fixture
def browser(tmp_path: Path) -> Iterator[Chromium]:
    with Chromium(tmp_path / "profile") as browser:
        yield browser


def correct(browser: Chromium, off: int) -> int:
    """Press the arrows that lead from a wrong proposal to the right step; gives how many."""
    tens, ones = divmod(abs(off), 10)
    arrow = "ArrowLeft" if off > 0 else "ArrowRight"
    for number in range(tens + ones):
        browser.press(arrow, shift=number < tens)
    return tens + ones


def test_fifty_proposals_are_judged_and_ten_wrong_ones_corrected(fill, served, browser, versions):
    ref = fill((*OFF, *(0,) * 40))
    begin(browser, served, ref.id)
    started, keys = time.monotonic(), 0
    for _ in range(50):
        browser.until(READY)
        told = browser.evaluate("document.querySelector('#doubt').textContent")
        proposed = int(re.search(r"step (\d+)", told).group(1))
        keys += correct(browser, proposed - RIGHT_STEP) + 1
        browser.press("Enter")
    browser.until("document.querySelector('#progress').textContent.startsWith('50 of 50 marked, 0 to go')")
    seconds = time.monotonic() - started
    browser.until("document.querySelector('#judging').hidden")
    end = time.monotonic() + 30
    while len(read_versions(versions)) < 50 and time.monotonic() < end:
        time.sleep(0.05)

    said = read_versions(versions)
    assert {label.step for label in agreed_labels(said, versions)} == {RIGHT_STEP}
    measures = measure(said)
    assert measures.judged == 50
    assert measures.keys == keys / 50 < 1.3
    assert measures.agreement == 42 / 50
    assert seconds < 120
    assert measures.minutes < 2
    paper = PAPER_TABLE_IV["one_leg"]
    rows = (
        ("", "here", "paper"),
        ("demonstrations annotated", str(measures.judged), "50"),
        ("minutes", f"{seconds / 60:.2f}", str(paper.annotating_min)),
        ("seconds a demonstration", f"{seconds / 50:.2f}", f"{paper.annotating_min * 60 / 50:.0f}"),
        ("keys a demonstration", f"{measures.keys:.2f}", "-"),
        ("proposals that were right", f"{measures.agreement:.0%}", "-"),
    )
    sys.stdout.write("\n" + "".join(f"{name:28}{here:>8}{there:>8}\n" for name, here, there in rows))


def test_what_is_sure_is_accepted_together_after_a_sample_of_five(fill, served, browser, versions):
    begin(browser, served, fill((0,) * 30).id)
    for _ in range(5):
        browser.until(READY)
        browser.press("Enter")
    browser.until("!document.querySelector('#offer').hidden")
    browser.press("KeyA")
    for _ in range(5):
        browser.until(READY)
        assert len(read_versions(versions)) <= 10
        browser.press("Enter")
    browser.until("document.querySelector('#progress').textContent.startsWith('30 of 30 marked, 0 to go')")
    browser.until("document.querySelector('#judging').hidden")
    time.sleep(1)
    measures = measure(read_versions(versions))
    assert (measures.judged, measures.keys) == (30, 11 / 30)
    browser.press("KeyU")
    browser.until("document.querySelector('#progress').textContent.startsWith('10 of 30 marked')")


def test_a_mark_that_somebody_else_made_meanwhile_is_shown_beside_ones_own(fill, served, browser, versions):
    begin(browser, served, fill((0,)).id)
    browser.until(READY)
    save(versions, [Entry(episode=f"{0:016x}", critical_state=0, step=25, after=0, author="Bob")])
    browser.press("Enter")
    browser.until("!document.querySelector('#conflict').hidden")
    shown = browser.evaluate("document.querySelector('#conflict').textContent")
    assert "Bob: step 25" in shown
    assert f"Ada (not saved yet): step {RIGHT_STEP}" in shown
    assert len(read_versions(versions)) == 1
    browser.press("Digit1")
    browser.until("document.querySelector('#conflict').hidden")
    browser.until("document.querySelector('#progress').textContent.startsWith('1 of 1 marked, 0 to go')")
    time.sleep(0.5)
    (label,) = agreed_labels(read_versions(versions), versions)
    assert label.step == 25


def test_what_cannot_be_saved_is_kept_and_saved_when_it_can_be(fill, served, browser, versions):
    begin(browser, served, fill((0, 0)).id)
    browser.until(READY)
    versions.parent.write_text("a file stands here")
    browser.press("Enter")
    browser.until("!document.querySelector('#trouble').hidden")
    assert "1 not saved, but kept here" in browser.evaluate("document.querySelector('#trouble').textContent")
    versions.parent.unlink()
    browser.press("Enter")
    browser.until("document.querySelector('#trouble').hidden")
    browser.until(READY)
    browser.press("Enter")
    browser.until("document.querySelector('#progress').textContent.startsWith('2 of 2 marked, 0 to go')")
    time.sleep(1)
    assert len(agreed_labels(read_versions(versions), versions)) == 2


def test_letters_can_be_switched_off(fill, served, browser):
    begin(browser, served, fill((0,)).id)
    browser.until(READY)

    def step() -> int:
        return int(browser.evaluate("document.querySelector('#timeline').getAttribute('aria-valuenow')"))

    for letter in "KKLHJ":
        browser.press(f"Key{letter}")
    browser.until(f"document.querySelector('#timeline').getAttribute('aria-valuenow') === '{RIGHT_STEP + 1}'")
    browser.evaluate("document.querySelector('#letters').click()")
    for code in ("KeyK", "KeyL", "ArrowRight"):
        browser.press(code)
    browser.until(f"document.querySelector('#timeline').getAttribute('aria-valuenow') === '{RIGHT_STEP + 2}'")
    assert step() == RIGHT_STEP + 2
