"""Keeping time by a clock that never goes back."""

from __future__ import annotations

_EARLY_S = 2e-3
"""A thread that sleeps may wake a little early; waiting again would cost a whole frame."""


class Beat:
    """Says when something that happens again and again is due.

    What is late happens late. A delay shorter than a period is made up for; a longer one is lost, for steps in quick
    succession would move an arm faster than its operator can see.

    Attributes:
        next_at: When it is due, in the clock's seconds.
    """

    def __init__(self, now: float) -> None:
        """Be due at once."""
        self.next_at = now

    def is_due(self, now: float) -> bool:
        """Whether it is due."""
        return now >= self.next_at - _EARLY_S

    def wait(self, period_s: float, now: float) -> None:
        """Be due again a period after it was."""
        self.next_at += period_s
        if self.next_at <= now:
            self.next_at = now + period_s
