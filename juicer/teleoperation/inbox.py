"""The newest message of whoever controls the robot, and whether it is still worth anything."""

from __future__ import annotations

import threading
from dataclasses import dataclass

from juicer.teleoperation.controls import ControllerState, Controls, Intent

DEAD_AFTER_S = 0.25
"""Nothing heard for so long means that nobody holds the controls."""


@dataclass(frozen=True)
class Heard:
    """What the operator wants at a moment.

    Attributes:
        intent: For the next control step; nothing if the operator is away.
        present: Whether somebody holds the controls.
        sequence: Number of the newest message; -1 before the first.
        source: Kind of device, empty before the first message.
    """

    intent: Intent
    present: bool
    sequence: int
    source: str


class Inbox:
    """Holds the newest state of one controller: written by whoever receives messages, read by the simulation."""

    def __init__(self, controls: Controls) -> None:
        """Begin with nobody at the controls."""
        self._lock = threading.Lock()
        self._controls = controls
        self._state: ControllerState | None = None
        self._at_s = 0.0
        self._last = -1
        self._released = True

    def take_over(self, controls: Controls) -> None:
        """Another controller begins: its counters and its sequence start anew."""
        with self._lock:
            self._controls = controls
            self._state, self._last, self._released = None, -1, True

    def put(self, state: ControllerState, now: float) -> bool:
        """Hear a message; False if it is a repeated or an overtaken one, which changes nothing."""
        with self._lock:
            if state.sequence <= self._last:
                return False
            self._state, self._at_s, self._last, self._released = state, now, state.sequence, False
            return True

    def release(self) -> None:
        """Nobody holds the controls until the next message."""
        with self._lock:
            self._released = True

    @property
    def sequence(self) -> int:
        """Number of the newest message; -1 before the first."""
        return self._last

    def get(self, now: float) -> Heard:
        """What is wanted now; presses are told once, so only the simulation may ask."""
        with self._lock:
            state = self._state
            source = state.source if state else ""
            if state is None or self._released or now - self._at_s > DEAD_AFTER_S:
                self._controls.release()
                return Heard(Intent(), False, self._last, source)
            return Heard(self._controls.intent(state), True, self._last, source)
