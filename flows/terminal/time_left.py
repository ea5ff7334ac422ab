"""How long running stages, and the run around them, may take yet; nothing is said that is not known."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from statistics import fmean

from juicer.progress import EXPECTED_STEPS, SECONDS_LEFT, STEPS

Call = tuple[str, str]
"""Name of a stage, and which condition, seed and round it runs for."""

LEAST_SHARE = 0.05
"""Of its units, that a stage must have done before its pace tells how long the others take."""


@dataclass
class Work:
    """One running stage; times are those of one clock, in seconds.

    Attributes:
        started: When it began, or went on after it had waited for something.
        before: How long it took when it last ran, if it did.
        done: Units that are finished.
        total: Of how many; 0 while that is not known.
    """

    started: float
    before: float | None = None
    done: int = 0
    total: int = 0
    _ends: float | None = None

    def report(self, done: int, total: int, facts: Mapping[str, float | str], now: float) -> None:
        """Take note of its progress."""
        self.done, self.total = done, total
        if not done and not total:
            self.started = now
        left = self._left(facts, now)
        self._ends = None if left is None else now + left

    def seconds_left(self, now: float) -> float | None:
        """Time until it is done: by its own pace as soon as that is known, by its last run until then."""
        ends = self._ends
        if ends is None and self.before is not None and now - self.started < self.before:
            ends = self.started + self.before
        return None if ends is None else max(0.0, ends - now)

    @property
    def share(self) -> float | None:
        """How much of it is done, from 0 to 1, if that is known."""
        return self.done / self.total if self.total else None

    def _left(self, facts: Mapping[str, float | str], now: float) -> float | None:
        if SECONDS_LEFT in facts:
            return float(facts[SECONDS_LEFT])
        if EXPECTED_STEPS in facts:
            # Episodes that run side by side end late and together: only steps tell how far they are.
            steps, expected = float(facts[STEPS]), float(facts[EXPECTED_STEPS])
            share = steps / expected if expected else 0.0
        else:
            share = self.share or 0.0
            share = share if share >= LEAST_SHARE else 0.0
        return (now - self.started) * (1 - share) / share if share else None


@dataclass
class Forecast:
    """What a run has before it.

    Attributes:
        workers: Stages that run at a time.
        expected: How long each call that is to come or running took when its like last ran, if it did; in their order,
            where several have one label.
        reusable: How many calls that the store knows already are to come.
        running: What runs.
    """

    workers: int
    expected: dict[Call, list[float | None]] = field(default_factory=dict)
    reusable: Counter[Call] = field(default_factory=Counter)
    running: dict[Call, Work] = field(default_factory=dict)
    _took: dict[str, list[float]] = field(default_factory=dict)

    @property
    def num_expected(self) -> int:
        """How many calls are to come or running."""
        return sum(map(len, self.expected.values()))

    def begin(self, call: Call, now: float) -> Work:
        """A stage begins."""
        seconds, *_ = self.expected.get(call, [None])
        self.running[call] = Work(now, self._before(call, seconds))
        return self.running[call]

    def end(self, call: Call, now: float, *, is_done: bool) -> float | None:
        """A stage is over; gives how long it ran, if it did."""
        work = self.running.pop(call, None)
        if work is None and self.reusable[call]:
            self.reusable[call] -= 1
            return None
        _, *further = self.expected.pop(call, [None])
        if further:
            self.expected[call] = further
        if work is None:
            return None
        if is_done:
            self._took.setdefault(call[0], []).append(now - work.started)
        return now - work.started

    def drop(self, label: str) -> None:
        """No stage of a condition and seed, in whatever round, is to come any more."""
        for call in list(self.expected):
            if f"{call[1]} ".startswith(f"{label} "):
                del self.expected[call]

    def seconds_left(self, now: float) -> tuple[float, bool]:
        """Time until everything expected is done, and whether nothing is missing in that estimate."""
        running = [work.seconds_left(now) for work in self.running.values()]
        waiting = [
            self._before(call, seconds)
            for call, expected in self.expected.items()
            for seconds in expected[call in self.running :]
        ]
        known = [seconds for seconds in running if seconds is not None]
        total = (sum(known) + sum(seconds for seconds in waiting if seconds is not None)) / self.workers
        return max([total, *known]), None not in running and None not in waiting

    def _before(self, call: Call, seconds: float | None) -> float | None:
        """How long such a call took when it last ran; else how long its stage took in this run."""
        took = self._took.get(call[0])
        return fmean(took) if seconds is None and took else seconds
