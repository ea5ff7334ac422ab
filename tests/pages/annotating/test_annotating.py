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
from juicer.episode import Source
from juicer.reporting.paper import PAPER_TABLE_IV
from juicer.sim.env import AssemblyEnv
from tests.pages.annotating.conftest import RIGHT_STEP, propose_for

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium on this machine"),
]

OFF = (10,) * 5 + (-1,) * 2 + (-11,) * 3
"""By how much ten proposals are wrong."""

EXAMPLES = """(() => {
  if (document.querySelector('#examples').hidden) return null;
  const step = (id) => document.querySelector(id).src.match(/([0-9]+)\\.jpg/)[1];
  return [step('#right'), document.querySelector('#right-text').textContent, step('#wrong')];
})()"""
"""Steps of the examples that are shown, and what the right one is said to show."""


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
    assert "Until one is chosen, training uses what is saved." in shown
    assert len(read_versions(versions)) == 1
    browser.press("Digit1")
    browser.until("document.querySelector('#conflict').hidden")
    browser.until("document.querySelector('#progress').textContent.startsWith('1 of 1 marked, 0 to go')")
    time.sleep(0.5)
    (label,) = agreed_labels(read_versions(versions), versions)
    assert label.step == 25


def test_who_agrees_with_what_was_marked_meanwhile_is_asked_nothing_and_the_rest_of_it_leaves_the_queue(
    fill, served, browser, versions
):
    begin(browser, served, fill((0, 0, 0)).id)
    browser.until(READY)
    about = {"critical_state": 0, "step": RIGHT_STEP + 1, "after": 0, "author": "Bob"}
    save(versions, [Entry(episode=f"{number:016x}", **about) for number in (0, 1)])
    browser.press("Enter")
    progress(browser, "2 of 3 marked, 1 to go")
    assert browser.evaluate("document.querySelector('#conflict').hidden")
    assert steps_said(versions, "Ada", 3) == {RIGHT_STEP}


def test_what_cannot_be_saved_is_kept_and_saved_when_it_can_be(fill, served, browser, versions):
    begin(browser, served, fill((0, 0)).id)
    browser.until(READY)
    versions.parent.write_text("a file stands here")
    browser.press("Enter")
    browser.until("!document.querySelector('#unsaved').hidden")
    assert "1 not saved, but kept here" in browser.evaluate("document.querySelector('#unsaved').textContent")
    versions.parent.unlink()
    browser.press("Enter")
    browser.until("document.querySelector('#unsaved').hidden")
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


def progress(browser: Chromium, begins: str) -> None:
    browser.until(f"document.querySelector('#progress').textContent.startsWith('{begins}')")


def hold(browser: Chromium, code: str, times: int) -> None:
    """Press a key, and hold it until it has repeated itself a few times."""
    browser.key_down(code)
    key = {"KeyU": "u"}.get(code, code)
    for _ in range(times):
        browser.call("Input.dispatchKeyEvent", type="rawKeyDown", key=key, code=code, autoRepeat=True)
    browser.key_up(code)


def steps_said(versions: Path, author: str, count: int) -> set[int | None]:
    """Steps that somebody has marked, once there are so many versions in all."""
    end = time.monotonic() + 30
    while len(said := read_versions(versions)) < count and time.monotonic() < end:
        time.sleep(0.05)
    assert len(said) == count
    return {version.step for version in said if version.author == author}


def test_of_marks_saved_together_only_the_one_that_somebody_contradicts_waits(fill, served, browser, versions):
    begin(browser, served, fill((3, 3, 3)).id)
    versions.parent.write_text("a file stands here")
    for number in range(3):
        browser.until(READY)
        correct(browser, 3)
        # By its button: Enter would try again to save the first.
        browser.evaluate("document.querySelector('#accept').click()")
        told = f"{number + 1} not saved, but kept here"
        browser.until(f"document.querySelector('#unsaved').textContent.includes('{told}')")
    versions.parent.unlink()
    save(versions, [Entry(episode=f"{1:016x}", critical_state=0, step=30, after=0, author="Bob")])
    browser.press("Enter")
    browser.until("!document.querySelector('#conflict').hidden")
    shown = browser.evaluate("document.querySelector('#conflict').textContent")
    assert "Bob: step 30" in shown
    assert f"Ada (not saved yet): step {RIGHT_STEP}" in shown
    assert steps_said(versions, "Ada", 3) == {RIGHT_STEP}
    browser.press("Digit2")
    progress(browser, "3 of 3 marked, 0 to go")
    assert steps_said(versions, "Ada", 4) == {RIGHT_STEP}
    assert {label.step for label in agreed_labels(read_versions(versions), versions)} == {RIGHT_STEP}


def test_a_mark_that_was_made_and_undone_elsewhere_does_not_take_ones_own_away(fill, served, browser, versions):
    begin(browser, served, fill((1,)).id)
    browser.until(READY)
    other = {"episode": f"{0:016x}", "critical_state": 0, "author": "Bob"}
    save(versions, [Entry(step=30, after=0, **other)])
    save(versions, [Entry(step=None, after=1, undoes=1, **other)])
    correct(browser, 1)
    browser.press("Enter")
    assert steps_said(versions, "Ada", 3) == {RIGHT_STEP}
    browser.until("document.querySelector('#judging').hidden")


def test_the_same_critical_state_marked_twice_in_a_row_is_saved_as_it_was_marked_last(fill, served, browser, versions):
    begin(browser, served, fill((1,)).id)
    browser.until(READY)
    # Both at once: the second is made before the first is answered.
    key = "document.body.dispatchEvent(new KeyboardEvent('keydown', {{key: '{}', bubbles: true}}))"
    browser.evaluate("; ".join(key.format(each) for each in (" ", "ArrowLeft", " ")))
    assert steps_said(versions, "Ada", 2) == {RIGHT_STEP + 1, RIGHT_STEP}
    assert [label.step for label in agreed_labels(read_versions(versions), versions)] == [RIGHT_STEP]
    assert browser.evaluate("document.querySelector('#unsaved').hidden")


def test_one_of_the_sample_that_was_wrong_on_a_second_look_ends_it(fill, served, browser, versions):
    begin(browser, served, fill((0,) * 12).id)
    for _ in range(5):
        browser.until(READY)
        browser.press("Enter")
    browser.until("!document.querySelector('#offer').hidden")
    browser.press("KeyA")
    for key in ("Enter", "KeyU"):
        browser.until(READY)
        browser.press(key)
    browser.until("document.querySelector('#progress').textContent.endsWith('sample: 5 to go')")
    browser.until(READY)
    for _ in range(3):
        browser.press("ArrowLeft")
    browser.press("Enter")
    browser.until("document.querySelector('#trouble').textContent.startsWith('One of the sample was wrong')")
    progress(browser, "6 of 12 marked, 6 to go")
    for _ in range(4):
        browser.until(READY)
        browser.press("Enter")
    progress(browser, "10 of 12 marked, 2 to go")


def test_what_is_not_saved_is_offered_until_it_is_saved(fill, served, browser, versions):
    begin(browser, served, fill((0, 0, 0)).id)
    browser.until(READY)
    versions.parent.write_text("a file stands here")
    browser.press("Enter")
    browser.until("!document.querySelector('#unsaved').hidden")
    versions.parent.unlink()
    browser.until(READY)
    # Another mark is saved, and something else is wrong meanwhile.
    browser.press("Space")
    progress(browser, "2 of 3 marked, 1 to go; 1 not saved")
    assert steps_said(versions, "Ada", 1) == {RIGHT_STEP}
    browser.evaluate("document.querySelector('#author').value = ''; document.querySelector('#accept').click()")
    browser.until("!document.querySelector('#trouble').hidden")
    assert not browser.evaluate("document.querySelector('#unsaved').hidden")
    browser.evaluate("document.querySelector('#unsaved button').click()")
    assert steps_said(versions, "Ada", 2) == {RIGHT_STEP}
    browser.until("document.querySelector('#unsaved').hidden")


def rename(browser: Chromium, name: str) -> None:
    browser.evaluate(
        f"document.querySelector('#author').value = '{name}';"
        "document.querySelector('#author').dispatchEvent(new Event('change'))"
    )


def test_a_mark_under_an_impossible_name_is_saved_under_the_corrected_one_or_dropped(fill, served, browser, versions):
    begin(browser, served, fill((0, 0)).id)
    browser.until(READY)
    rename(browser, "Ada\\u200b")
    browser.press("Enter")
    browser.until("document.querySelector('#unsaved').textContent.includes('Drop 1 that cannot be saved')")
    assert not browser.evaluate("document.querySelector('#unsaved').textContent.includes('Try again')")
    rename(browser, "Ada")
    browser.until("document.querySelector('#unsaved').hidden")
    assert steps_said(versions, "Ada", 1) == {RIGHT_STEP}
    browser.until(READY)
    rename(browser, "Bob\\u200b")
    browser.press("Enter")
    browser.until("document.querySelector('#unsaved').textContent.includes('Drop 1')")
    browser.press("Delete")
    browser.until("document.querySelector('#unsaved').hidden")
    progress(browser, "1 of 2 marked, 1 to go")
    assert len(read_versions(versions)) == 1


def test_more_than_one_message_holds_is_accepted_together_and_undone_together(fill, served, browser, versions):
    begin(browser, served, fill((0,) * 512).id)
    for _ in range(5):
        browser.until(READY)
        browser.press("Enter")
    browser.until("!document.querySelector('#offer').hidden")
    browser.press("KeyA")
    for _ in range(5):
        browser.until(READY)
        browser.press("Enter")
    progress(browser, "512 of 512 marked, 0 to go")
    assert steps_said(versions, "Ada", 512) == {RIGHT_STEP}
    browser.press("KeyU")
    progress(browser, "10 of 512 marked, 502 to go")


def test_one_person_on_two_pages_is_asked_which_of_both_marks_is_right(fill, served, browser, versions):
    begin(browser, served, fill((0,)).id)
    browser.until(READY)
    save(versions, [Entry(episode=f"{0:016x}", critical_state=0, step=25, after=0, author="Ada")])
    browser.press("Enter")
    browser.until("!document.querySelector('#conflict').hidden")
    shown = browser.evaluate("document.querySelector('#conflict').textContent")
    assert shown.startswith("You marked this critical state differently elsewhere. Which step is right?")
    assert "Ada: step 25" in shown
    assert "leave it open" not in shown


def test_a_mark_after_the_last_step_of_an_episode_is_no_choice(fill, served, browser, versions):
    begin(browser, served, fill((0,)).id)
    browser.until(READY)
    save(versions, [Entry(episode=f"{0:016x}", critical_state=0, step=9999, after=0, author="Bob")])
    browser.press("Enter")
    browser.until("!document.querySelector('#conflict').hidden")
    shown = browser.evaluate("document.querySelector('#conflict').textContent")
    assert "null" not in shown
    assert "Bob" not in shown
    assert f"Ada (not saved yet): step {RIGHT_STEP}" in shown


def test_one_mark_far_from_a_sure_proposal_is_no_example(fill, served, browser, versions):
    ref = fill((0, 0))
    save(versions, [Entry(episode=f"{0:016x}", critical_state=0, step=38, after=0, author="Bob")])
    begin(browser, served, ref.id)
    browser.until(READY)
    right, _, wrong = browser.evaluate(EXAMPLES)
    assert (right, wrong) == (str(RIGHT_STEP), str(RIGHT_STEP + 15))


def test_a_key_that_is_held_moves_but_decides_once(fill, served, browser, versions):
    begin(browser, served, fill((-5,) * 5).id)
    browser.until(READY)
    hold(browser, "ArrowRight", 4)
    hold(browser, "Enter", 3)
    progress(browser, "1 of 5 marked, 4 to go")
    assert steps_said(versions, "Ada", 1) == {RIGHT_STEP}
    browser.until(READY)
    browser.press("Enter")
    progress(browser, "2 of 5 marked, 3 to go")
    hold(browser, "KeyU", 3)
    progress(browser, "1 of 5 marked, 4 to go")
    time.sleep(0.5)
    assert [version.undoes for version in read_versions(versions)] == [None, None, 2]
    # Nor does a button that has the focus.
    browser.evaluate("document.querySelector('#accept').focus()")
    hold(browser, "Enter", 3)
    progress(browser, "2 of 5 marked, 3 to go")
    time.sleep(0.5)
    assert len(read_versions(versions)) == 4


def test_a_correction_of_which_nothing_was_found_is_marked_by_hand(fill, served, browser, versions):
    facts = {"source": Source.CORRECTION, "parent": "0123456789abcdef", "parent_step": 300}
    begin(browser, served, fill((None,), **facts).id)
    browser.until(READY)
    assert "nothing was proposed" in browser.evaluate("document.querySelector('#doubt').textContent")
    assert "○ missing" in browser.evaluate("document.querySelector('#marks').textContent")
    assert browser.evaluate("document.querySelector('#examples').hidden")
    browser.press("Home")
    hold(browser, "ArrowRight", 6)
    browser.press("Enter")
    progress(browser, "1 of 1 marked, 0 to go")
    assert steps_said(versions, "Ada", 1) == {7}
    # What somebody has marked serves as the example.
    browser.press("KeyU")
    browser.until("!document.querySelector('#judging').hidden")


def test_examples_are_of_the_critical_state_that_is_judged(tmp_path, episode_factory, served, browser):
    env = AssemblyEnv("lamp")
    env.reset(seed=0)
    episode = episode_factory(30, task="lamp", num_parts=3, sim_state_size=len(env.get_state()))
    episode.steps["sim_state"][:] = env.get_state()
    episode.final["sim_state"][:] = env.get_state()
    begin(browser, served, propose_for(tmp_path, episode, {1: 4, 2: 9}, 0.8).id)
    browser.until("!document.querySelector('#judging').hidden")
    shown = []
    for _ in range(5):
        shown.append(browser.evaluate(EXAMPLES))
        browser.press("ArrowDown")
    assert shown == [
        None,
        ["4", "the gripper is open, and still a little away from the bulb", "19"],
        ["9", "the bulb is held, and still clear of what it goes into", "24"],
        None,
        None,
    ]


def test_a_machine_that_cannot_draw_says_so_once_and_is_left_alone(fill, tmp_path, browser):
    ref = fill((0, 0, 0))
    with serving(tmp_path / "data", JUICER_WORKERS="1", MUJOCO_GL="disable") as served:
        begin(browser, served, ref.id)
        browser.until("document.querySelector('#trouble').textContent.includes('o OpenGL platform can draw')")
        time.sleep(1)
        asked = "performance.getEntriesByType('resource').length"
        before = browser.evaluate(asked)
        time.sleep(2)
        assert browser.evaluate(asked) == before < 60


def lose_the_answer(browser: Chromium, path: str) -> None:
    """Have the next answer to what is told the server lost on its way, after the server did what it was told."""
    browser.evaluate(f"""(() => {{
      const ask = window.fetch;
      window.fetch = async (address, ...more) => {{
        const answer = await ask(address, ...more);
        if (!address.endsWith('{path}')) return answer;
        window.fetch = ask;
        throw new Error('lost');
      }};
    }})()""")


NOTHING_UNDONE = "document.querySelector('#trouble').textContent.startsWith('Nothing was undone')"


def test_of_what_was_accepted_together_all_is_undone_or_nothing(fill, served, browser, versions):
    begin(browser, served, fill((0,) * 20).id)
    for _ in range(5):
        browser.until(READY)
        browser.press("Enter")
    browser.until("!document.querySelector('#offer').hidden")
    browser.press("KeyA")
    for _ in range(5):
        browser.until(READY)
        browser.press("Enter")
    progress(browser, "20 of 20 marked, 0 to go")
    assert steps_said(versions, "Ada", 20) == {RIGHT_STEP}
    # In the middle of those that were accepted together.
    about = read_versions(versions)[15]
    save(versions, [Entry(episode=about.episode, critical_state=0, step=30, after=16, author="Bob")])
    browser.press("KeyU")
    browser.until(NOTHING_UNDONE)
    assert "meanwhile by Bob" in browser.evaluate("document.querySelector('#trouble').textContent")
    browser.until("!document.querySelector('#conflict').hidden")
    progress(browser, "20 of 20 marked")
    assert len(read_versions(versions)) == 21
    browser.press("KeyU")
    progress(browser, "11 of 20 marked, 9 to go")
    assert browser.evaluate("document.querySelector('#trouble').hidden")
    assert sorted(version.undoes or 0 for version in read_versions(versions)) == [0] * 21 + list(range(11, 21))


def test_undoing_again_after_a_lost_answer_takes_back_nothing_older(fill, served, browser, versions):
    begin(browser, served, fill((1,)).id)
    browser.until(READY)
    browser.press("Space")
    browser.press("ArrowLeft")
    browser.press("Space")
    assert steps_said(versions, "Ada", 2) == {RIGHT_STEP + 1, RIGHT_STEP}
    lose_the_answer(browser, "/undo")
    browser.press("KeyU")
    browser.until(NOTHING_UNDONE)
    browser.press("KeyU")
    browser.until("document.querySelector('#trouble').hidden")
    shown = f"document.querySelector('#state').textContent === '✓ you marked step {RIGHT_STEP + 1}'"
    browser.until(shown)
    assert [version.undoes for version in read_versions(versions)] == [None, None, 2]
    browser.press("KeyU")
    progress(browser, "0 of 1 marked, 1 to go")
    assert [version.undoes for version in read_versions(versions)] == [None, None, 2, 1]


def test_a_mark_that_was_saved_although_the_answer_was_lost_is_undone_on_the_disk(fill, served, browser, versions):
    begin(browser, served, fill((0,)).id)
    browser.until(READY)
    lose_the_answer(browser, "/marks")
    browser.press("Enter")
    browser.until("!document.querySelector('#unsaved').hidden")
    browser.press("KeyU")
    progress(browser, "0 of 1 marked, 1 to go")
    browser.until("document.querySelector('#unsaved').hidden")
    assert [version.undoes for version in read_versions(versions)] == [None, 1]
