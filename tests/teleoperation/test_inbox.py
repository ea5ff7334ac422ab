"""The newest message counts, once, as long as it is fresh."""

from __future__ import annotations

import pytest

from juicer.teleoperation.controls import ControllerState, Controls
from juicer.teleoperation.inbox import DEAD_AFTER_S, Inbox
from juicer.teleoperation.key_maps import Action


def state(sequence: int, *held: str, **edges: int) -> ControllerState:
    return ControllerState(source="keyboard", sequence=sequence, held=frozenset(held), edges=edges)


@pytest.fixture
def inbox() -> Inbox:
    return Inbox(Controls())


def test_nobody_is_present_before_the_first_message(inbox):
    assert not inbox.get(0.0).present


def test_the_newest_message_is_what_is_wanted(inbox):
    inbox.put(state(1, "KeyW"), 0.0)
    inbox.put(state(2), 0.1)
    heard = inbox.get(0.1)
    assert heard.present
    assert (heard.intent.moves, heard.sequence) == (False, 2)


def test_a_repeated_or_overtaken_message_changes_nothing(inbox):
    assert inbox.put(state(5), 0.0)
    assert not inbox.put(state(5, "KeyW"), 0.0)
    assert not inbox.put(state(4, "KeyW"), 0.0)
    assert not inbox.get(0.0).intent.moves


def test_silence_is_no_wish(inbox):
    inbox.put(state(1, "KeyW"), 0.0)
    assert inbox.get(DEAD_AFTER_S).intent.moves
    heard = inbox.get(DEAD_AFTER_S + 0.001)
    assert not heard.present
    assert not heard.intent.moves


def test_released_controls_are_held_again_with_the_next_message_only(inbox):
    inbox.put(state(1, "KeyW"), 0.0)
    inbox.release()
    assert not inbox.get(0.0).present
    assert not inbox.put(state(1, "KeyW"), 0.0)
    assert not inbox.get(0.0).present
    inbox.put(state(2, "KeyW"), 0.0)
    assert inbox.get(0.0).present


def test_a_press_is_told_once(inbox):
    inbox.put(state(1, KeyB=1), 0.0)
    assert inbox.get(0.0).intent.presses == {Action.UNDO}
    inbox.put(state(2, KeyB=1), 0.0)
    assert not inbox.get(0.0).intent.presses


def test_whoever_takes_over_begins_with_nothing_held_and_counts_anew(inbox):
    inbox.put(state(100, "KeyW"), 0.0)
    inbox.take_over(Controls())
    assert not inbox.get(0.0).present
    assert inbox.put(state(1), 0.0)
