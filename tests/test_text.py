"""What comes from elsewhere reaches a terminal as harmless text."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from juicer.text import printable


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("plain words, ümläute, 手", "plain words, ümläute, 手"),
        ("\x1b[2J\x1b]0;owned\x07", r"\x1b[2J\x1b]0;owned\x07"),
        ("two\nlines\tand a tab", r"two\nlines\tand a tab"),
        ("right\u202eto left", r"right\u202eto left"),
        ("\udc80", r"\udc80"),
        ("\x9b31m", r"\x9b31m"),
    ],
)
def test_what_could_steer_a_terminal_is_escaped(text: str, shown: str):
    assert printable(text) == shown


def test_a_long_text_is_cut():
    assert printable("x" * 20_000_000, longest=10) == "xxxxxxxxx…"


@given(st.text())
def test_whatever_it_is_given_stays_one_line_that_can_be_encoded(text: str):
    shown = printable(text)
    assert shown.encode("utf-8").decode() == shown
    assert len(shown.splitlines()) <= 1
