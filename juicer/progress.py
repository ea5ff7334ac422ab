"""How long-running library code reports what it is doing, without knowing who listens."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

SECONDS_LEFT, STEPS, EXPECTED_STEPS = "seconds_left", "steps", "expected_steps"
"""Facts of a progress report that tell how long work takes yet: its own estimate; or the steps that are done, and
those that all of it is expected to take, 0 while that is not known."""


class Progress(Protocol):
    """Listener for the advance of one piece of work."""

    def __call__(self, done: int, total: int, **facts: float | str) -> None:
        """Report that ``done`` of ``total`` units are finished, with facts worth showing."""
        ...


class MetricSink(Protocol):
    """Listener for numbers that form curves."""

    def log(self, metrics: Mapping[str, float], step: int) -> None:
        """Record metrics at a step."""
        ...


def silent_progress(done: int, total: int, **facts: float | str) -> None:
    """Progress listener that listens to nothing."""


class NullMetricSink:
    """Metric sink that keeps nothing."""

    def log(self, metrics: Mapping[str, float], step: int) -> None:
        """Drop the metrics."""


@dataclass
class EpisodeSteps:
    """How many steps episodes that run side by side will take in all: they end late, together, and each at its limit.

    An episode that runs may go on like those that have ended after at least as many steps, or like those that run
    longer than it does (the estimate of Kaplan and Meier).

    Attributes:
        episodes: That are run at most; 0 if nobody knows.
        abreast: That run side by side.
        limit: Steps after which an episode ends in any case.
        successes: Enough of which end it all; none if they do not.
        running: Steps of each episode that runs.
    """

    episodes: int
    abreast: int
    limit: int
    successes: int | None = None
    running: Sequence[int] = ()
    _ended: Counter[int] = field(default_factory=Counter)
    _succeeded: int = 0

    def end(self, length: int, *, succeeded: bool) -> None:
        """An episode has ended."""
        self._ended[length] += 1
        self._succeeded += succeeded

    def facts(self) -> dict[str, float]:
        """Steps that are done, and those that are expected in all, for a progress report."""
        done = sum(self._ended.elements()) + sum(self.running)
        # The first to end are the quickest: they alone would promise too much.
        if not self.episodes or 4 * self._ended.total() < 3 * min(self.abreast, self.episodes):
            return {STEPS: done, EXPECTED_STEPS: 0}
        to_begin = max(0.0, self._expected_episodes() - self._ended.total() - len(self.running))
        living = self._share_living()
        left = sum(_mean_beyond(living, age) for age in self.running) + to_begin * _mean_beyond(living, 0)
        return {STEPS: done, EXPECTED_STEPS: round(done + left)}

    def _expected_episodes(self) -> float:
        if self.successes is None:
            return self.episodes
        rate = (self._succeeded + 0.5) / (self._ended.total() + 1)
        return min(self.episodes, self.successes / rate)

    def _share_living(self) -> list[float]:
        """Share of episodes that take more than 0, 1, 2 ... steps, up to the limit."""
        known = self._ended + Counter(self.running)
        at_risk, living, share = known.total(), [], 1.0
        for length in range(self.limit):
            if ended := self._ended[length]:
                share *= 1 - ended / at_risk
            at_risk -= known[length]
            living.append(share)
        return living


def _mean_beyond(living: Sequence[float], age: int) -> float:
    """Mean of the steps that an episode of an age takes yet."""
    beyond = living[age:]
    return sum(beyond) / beyond[0] if beyond and beyond[0] else float(len(beyond) > 0)
