"""How long running stages, and the run around them, may take yet; nothing is said that is not known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from statistics import fmean

from juicer.progress import EXPECTED_STEPS, SECONDS_LEFT, STEPS

LEAST_SHARE = 0.05
"""Of its units, that a stage must have done before its pace tells how long the others take."""


@dataclass(frozen=True)
class Call:
    """A stage call that is to come.

    Attributes:
        stage: Name of the stage.
        label: Which condition, seed and round it runs for.
        seconds: How long its like took when it last ran, if it did.
    """

    stage: str
    label: str
    seconds: float | None = None


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
        expected: Calls to come or running, by the artifacts that they make.
        running: What runs, likewise.
    """

    workers: int
    expected: dict[str, Call] = field(default_factory=dict)
    running: dict[str, Work] = field(default_factory=dict)
    _took: dict[str, list[float]] = field(default_factory=dict)

    def begin(self, artifact: str, stage: str, now: float) -> Work:
        """A stage begins."""
        self.running[artifact] = Work(now, self._before(self.expected.get(artifact, Call(stage, ""))))
        return self.running[artifact]

    def end(self, artifact: str, stage: str, now: float, *, is_done: bool) -> float | None:
        """A stage is over; gives how long it ran, if it did."""
        self.expected.pop(artifact, None)
        work = self.running.pop(artifact, None)
        if work is None:
            return None
        if is_done:
            self._took.setdefault(stage, []).append(now - work.started)
        return now - work.started

    def drop(self, label: str) -> None:
        """No stage of a condition and seed, in whatever round, is to come any more."""
        for artifact, call in list(self.expected.items()):
            if f"{call.label} ".startswith(f"{label} "):
                del self.expected[artifact]

    def seconds_left(self, now: float) -> tuple[float, bool]:
        """Time until everything expected is done, and whether nothing is missing in that estimate."""
        running = [work.seconds_left(now) for work in self.running.values()]
        waiting = [self._before(call) for artifact, call in self.expected.items() if artifact not in self.running]
        known = [seconds for seconds in running if seconds is not None]
        total = (sum(known) + sum(seconds for seconds in waiting if seconds is not None)) / self.workers
        return max([total, *known]), None not in running and None not in waiting

    def _before(self, call: Call) -> float | None:
        """How long such a call took when it last ran; else how long its stage took in this run."""
        took = self._took.get(call.stage)
        return fmean(took) if call.seconds is None and took else call.seconds
