"""Messages of pages and devices, judged before anything is done with them; whatever is sent, the answer is a sentence.

A message is one JSON object, the whole state of the sender's devices; docs/teleoperation.md describes it.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any, NoReturn, get_args

from juicer.errors import RefusedMessage
from juicer.problems import show
from juicer.teleoperation.controls import CLUTCH, ControllerState, Device
from juicer.teleoperation.key_codes import GAMEPAD_BUTTONS, KEY_CODES, KEYS_OF_THE_PAGE, SPACEMOUSE_BUTTONS
from juicer.teleoperation.key_maps import Action, Motion
from juicer.text import printable

MOST_BYTES = 8_192
"""Largest message."""
MOST_HELD = 32
"""Keys and buttons that are held at once; two hands have ten fingers, and keyboards report few more."""
MOST_COUNTED = 2**31
"""Largest number of a message, and largest count of presses."""
MOST_PRESSES = 100
"""Presses of one key from one message to the next; more were not made by a finger."""
FARTHEST_M = 10.0
"""How far a pose device may be from where its clutch was closed."""
LARGEST_TURN_RAD = 2 * math.pi

DEVICES: tuple[Device, ...] = get_args(Device)
NAMES: frozenset[str] = (
    KEY_CODES
    | set(KEYS_OF_THE_PAGE)
    | set(GAMEPAD_BUTTONS)
    | set(SPACEMOUSE_BUTTONS)
    | set(Action)
    | {Motion.SLOW, CLUTCH}
)
"""All that can be held or pressed."""

_KEYS = ("source", "sequence", "held", "edges", "axes", "twist", "pose_delta", "clutch")
_MOST_DIGITS = 25


class MessageReader:
    """Reads the messages of one connection, in their order."""

    def __init__(self) -> None:
        """Begin with the connection."""
        self._sequence = -1
        self._edges: Mapping[str, int] = {}

    def read(self, message: bytes | str) -> ControllerState:
        """The state that a message tells of.

        Raises:
            RefusedMessage: If it is no such message, or none that can follow those before it; one sentence says why.
                What it says is not to be acted on; the next one may be good again.
        """
        state = parse_state(message)
        if state.sequence <= self._sequence:
            raise RefusedMessage(
                f"message {state.sequence} comes after message {self._sequence}: it was repeated or overtaken"
            )
        for name, count in self._edges.items():
            if not 0 <= state.edges.get(name, 0) - count <= MOST_PRESSES:
                raise RefusedMessage(
                    f"'{name}' cannot have been pressed {state.edges.get(name, 0)} times after {count} times; count "
                    "presses from the beginning of the connection, and open a new one to begin anew"
                )
        self._sequence, self._edges = state.sequence, state.edges
        return state


def parse_state(message: bytes | str) -> ControllerState:
    """Read one message, whatever came before it.

    Raises:
        RefusedMessage: If it is no such message; one sentence says why.
    """
    content = _object(message)
    if unknown := [key for key in content if key not in _KEYS]:
        raise RefusedMessage(f"a message has no entry '{printable(unknown[0], 40)}'; it has {', '.join(_KEYS)}")
    source = content.get("source")
    if source not in DEVICES:
        raise RefusedMessage(f"'source' must be one of {', '.join(DEVICES)}, got {show(source)}")
    clutch = content.get("clutch", False)
    if not isinstance(clutch, bool):
        raise RefusedMessage(f"'clutch' must be true or false, got {show(clutch)}")
    delta = _numbers(content, "pose_delta", 6, FARTHEST_M)
    if delta and math.hypot(*delta[3:]) > LARGEST_TURN_RAD:
        raise RefusedMessage("the rotation of 'pose_delta' is more than one turn; send its rotation vector in radians")
    return ControllerState(
        source=source,
        sequence=_count(content.get("sequence"), "sequence"),
        held=_held(content.get("held", [])),
        edges=_edges(content.get("edges", {})),
        axes=_numbers(content, "axes", 6, 1.0) or (),
        twist=_numbers(content, "twist", 6, 1.0),
        pose_delta=delta,
        clutch=clutch,
    )


def _object(message: bytes | str) -> dict[str, Any]:
    if len(message) > MOST_BYTES:
        raise RefusedMessage(f"a message has at most {MOST_BYTES:,} bytes, this one has {len(message):,}")
    try:
        text = message.decode() if isinstance(message, bytes) else message
        content = json.loads(
            text, parse_constant=_refuse_constant, parse_int=_whole, object_pairs_hook=_without_repetition
        )
    except RecursionError:
        raise RefusedMessage("a message is one JSON object, and this is nested too deeply") from None
    except ValueError:
        raise RefusedMessage(f"a message is one JSON object, got {show(message)}") from None
    if not isinstance(content, dict):
        raise RefusedMessage(f"a message is one JSON object, got {show(content)}")
    return content


def _held(value: object) -> frozenset[str]:
    if not isinstance(value, list) or len(value) > MOST_HELD:
        raise RefusedMessage(f"'held' must be a list of at most {MOST_HELD} keys and buttons, got {show(value)}")
    return frozenset(_name(each, "held") for each in value)


def _edges(value: object) -> dict[str, int]:
    if not isinstance(value, dict):
        raise RefusedMessage(f"'edges' must be an object of counts by key or button, got {show(value)}")
    return {_name(name, "edges"): _count(count, f"edges.{printable(name, 40)}") for name, count in value.items()}


def _name(value: object, where: str) -> str:
    if not isinstance(value, str) or value not in NAMES:
        raise RefusedMessage(f"'{where}' names a key or button that there is not: {show(value)}")
    return value


def _count(value: object, where: str) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < MOST_COUNTED:
        raise RefusedMessage(f"'{where}' must be a whole number from 0 to {MOST_COUNTED - 1}, got {show(value)}")
    return value


def _numbers(content: Mapping[str, Any], name: str, size: int, largest: float) -> tuple[float, ...] | None:
    value = content.get(name)
    if value is None:
        return None
    if not isinstance(value, list) or len(value) != size:
        raise RefusedMessage(f"'{name}' must be a list of {size} numbers, got {show(value)}")
    for each in value:
        if not isinstance(each, int | float) or isinstance(each, bool) or not abs(each) <= largest:
            raise RefusedMessage(f"'{name}' must hold numbers from {-largest:g} to {largest:g}, got {show(each)}")
    return tuple(float(each) for each in value)


def _whole(digits: str) -> int:
    if len(digits) > _MOST_DIGITS:
        raise ValueError
    return int(digits)


def _refuse_constant(name: str) -> NoReturn:
    raise RefusedMessage(f"a message holds finite numbers, this one holds {name}")


def _without_repetition(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    if len(content) < len(pairs):
        raise RefusedMessage("an object of the message says one name twice")
    return content
