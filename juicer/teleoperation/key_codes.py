"""Names of keys and buttons that browsers know."""

from __future__ import annotations

import string
from collections.abc import Mapping

GAMEPAD_BUTTONS = (
    "A", "B", "X", "Y", "LB", "RB", "LT", "RT", "Back", "Start", "LS", "RS", "Up", "Down", "Left", "Right", "Guide",
)  # fmt: skip
"""Buttons of the Gamepad API's standard mapping, in its order."""

SPACEMOUSE_BUTTONS = ("Button0", "Button1")
"""The left and the right button of a SpaceMouse; what larger models have besides means nothing."""

KEYS_OF_THE_PAGE: Mapping[str, str] = {
    "Tab": "it moves the focus from one control of the page to the next",
    "Escape": "it closes what is open on the page",
    "Slash": "the page shows its keys with it",
    **{
        f"{name}{side}": "browsers make their own shortcuts with it"
        for name in ("Control", "Alt", "Meta")
        for side in ("Left", "Right")
    },
}
"""Keys that no key map may have, and why."""

KEY_CODES: frozenset[str] = frozenset(
    [
        *(f"Key{letter}" for letter in string.ascii_uppercase),
        *(f"Digit{digit}" for digit in string.digits),
        *(f"Numpad{digit}" for digit in string.digits),
        *(f"F{number}" for number in range(1, 25)),
        *(f"Numpad{name}" for name in ("Add", "Subtract", "Multiply", "Divide", "Decimal", "Enter", "Equal", "Comma")),
        *(f"Arrow{name}" for name in ("Up", "Down", "Left", "Right")),
        *("ShiftLeft", "ShiftRight"),
        *("Space", "Enter", "Backspace", "Delete", "Insert", "Home", "End", "PageUp", "PageDown", "CapsLock"),
        *("Backquote", "Minus", "Equal", "BracketLeft", "BracketRight", "Backslash", "Semicolon", "Quote", "Comma"),
        *("Period", "IntlBackslash", "IntlRo", "IntlYen", "ContextMenu", "Pause", "ScrollLock", "NumLock"),
    ]
)
"""``KeyboardEvent.code`` of keys that can be bound; a code is a place on the keyboard, not a letter."""
