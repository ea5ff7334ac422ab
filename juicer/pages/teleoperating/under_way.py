"""Frames on their way to a page: as many as its line takes time for, and no more, so that none waits for another."""

from __future__ import annotations

import math

from juicer.teleoperation.session import FRAME_S

FEWEST = 2
"""One that is painted while the next one travels."""
MOST = 8


class UnderWay:
    """Frames that were sent and not yet acknowledged.

    The shortest time from sending a frame to hearing that it was painted is what the line and the browser need when
    nothing waits: however many frames queue on a thin line, it does not grow, and so no more of them are sent.
    """

    def __init__(self) -> None:
        """Begin with none."""
        self._sent_s: dict[int, float] = {}
        self._shortest_s = math.inf

    @property
    def is_full(self) -> bool:
        """Whether another frame would have to wait on its way."""
        return len(self._sent_s) >= self._most

    def send(self, number: int, now: float) -> None:
        """A frame leaves."""
        self._sent_s[number] = now

    def painted(self, number: int, now: float) -> None:
        """A page has painted a frame; one that was not sent, or was acknowledged before, counts nothing."""
        if (sent := self._sent_s.pop(number, None)) is not None:
            self._shortest_s = min(self._shortest_s, now - sent)

    @property
    def _most(self) -> int:
        if math.isinf(self._shortest_s):
            return FEWEST
        return min(FEWEST + int(self._shortest_s / FRAME_S), MOST)
