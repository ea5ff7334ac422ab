"""Progress in the terminal: live bars where there is a terminal, plain lines now and then where there is none."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Mapping
from types import TracebackType
from typing import Any, Self

from rich.console import Console, RenderableType
from rich.progress import BarColumn, TextColumn
from rich.progress import Progress as Bars
from rich.text import Text

from flows.terminal.headline import duration, headline, rejections
from flows.terminal.time_left import Call, Forecast, Work
from juicer.progress import EXPECTED_STEPS, SECONDS_LEFT, Progress
from stages.runtime.facts import number

REFRESHES_PER_SECOND = 4
PLAIN_SECONDS = 15.0
BAR_WIDTH = 24
_MARKS = {"done": ("✓", "green"), "reused": ("↺", "cyan"), "failed": ("✗", "red"), "stopped": ("■", "yellow")}
_TOLD_OTHERWISE = (SECONDS_LEFT, EXPECTED_STEPS)


class Board:
    """Shows which stages run, how far they are, and how long the rest may take; to be used in a ``with`` statement."""

    def __init__(
        self, console: Console | None = None, workers: int = 1, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """Begin with nothing to show.

        Args:
            console: Where it is shown; standard error by default.
            workers: Stages that run at a time.
            clock: Gives the time, in seconds since whenever.
        """
        self.console = console or Console(stderr=True, highlight=False)
        # Not to be held while something is printed: what prints asks for the line about the whole run.
        self._lock = threading.Lock()
        self._forecast = Forecast(workers)
        self._clock = clock
        self._started = clock()
        self._finished = 0
        self._bars = _Bars(self.console, self._total)

    def __enter__(self) -> Self:
        """Begin to show."""
        self._bars.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Leave nothing but the lines of finished stages."""
        self._bars.stop()

    def expect(self, calls: Mapping[str, Call]) -> None:
        """Learn which artifacts are to be made, and by which calls."""
        with self._lock:
            self._forecast.expected = dict(calls)

    def say(self, message: str) -> None:
        """Print a line that stays."""
        self.console.print(message, markup=False, soft_wrap=True)

    def started(self, stage: str, label: str, artifact: str) -> Progress:
        """A stage begins."""
        spoken = self._clock()
        with self._lock:
            work = self._forecast.begin(artifact, stage, spoken)
        bar = self._bars.add_task(f"{stage} {label}", total=None, state="begins", facts="")
        if self._bars.disable:
            self.say(f"{_time_of_day()}  {stage:9} {label:24} begins")

        def progress(done: int, total: int, **facts: float | str) -> None:
            nonlocal spoken
            now = self._clock()
            with self._lock:
                work.report(done, total, facts, now)
            state, shown = _state(work, now), _facts(facts)
            self._bars.update(bar, completed=done, total=total or None, state=state, facts=shown)
            if self._bars.disable and now - spoken >= PLAIN_SECONDS:
                spoken = now
                line = f"{state}  {shown}".rstrip()
                self.say(f"{_time_of_day()}  {stage:9} {label:24} {line}; {self._total()}")

        return progress

    def finished(self, stage: str, label: str, artifact: str, state: str, summary: Mapping[str, Any]) -> None:
        """A stage is over."""
        with self._lock:
            seconds = self._forecast.end(artifact, stage, self._clock(), is_done=state == "done")
            self._finished += state in ("done", "reused")
        for bar in self._bars.tasks:
            if bar.description == f"{stage} {label}":
                self._bars.remove_task(bar.id)
        mark, colour = _MARKS[state]
        took = f"{state if seconds is None else duration(seconds):>8}"
        text = f"{_time_of_day()}  {mark} {stage:9} {label:24} {took}  {headline(summary)}"
        self.console.print(Text(text.rstrip(), style=colour if state == "failed" else ""), soft_wrap=True)
        for rejection in rejections(summary) if state == "done" else ():
            self.say(f"            {rejection}")

    def settled(self, label: str) -> None:
        """Nothing more is to come for a condition and seed: a round or an evaluation ended early."""
        with self._lock:
            self._forecast.drop(label)

    def seconds_left(self) -> tuple[float, bool]:
        """Wall time until everything expected is done, and whether nothing is missing in that estimate."""
        with self._lock:
            return self._forecast.seconds_left(self._clock())

    def _total(self) -> str:
        seconds, is_complete = self.seconds_left()
        waiting = len(self._forecast.expected)
        so_far = f"{duration(self._clock() - self._started)} so far, {self._finished} stages done"
        if not waiting:
            return so_far
        if seconds < 1 and not is_complete:
            return f"{so_far}, {waiting} to go"
        return f"{so_far}, {waiting} to go, {'about' if is_complete else 'more than'} {duration(seconds)} left"


class _Bars(Bars):
    """A bar for each stage, and a line about the whole run."""

    def __init__(self, console: Console, total: Callable[[], str]) -> None:
        self._total = total
        super().__init__(
            TextColumn("{task.description}", markup=False),
            BarColumn(BAR_WIDTH),
            TextColumn("{task.fields[state]}", markup=False),
            TextColumn("{task.fields[facts]}", style="dim", markup=False),
            console=console,
            transient=True,
            refresh_per_second=REFRESHES_PER_SECOND,
            disable=not console.is_terminal,
        )

    def get_renderables(self) -> Iterable[RenderableType]:
        yield from super().get_renderables()
        yield Text(self._total(), style="dim")


def _time_of_day() -> str:
    return time.strftime("%H:%M:%S")


def _state(work: Work, now: float) -> str:
    if work.share is None:
        count = f"{work.done}" if work.done else "begins"
    else:
        count = f"{work.done}/{work.total} {work.share:4.0%}"
    left = work.seconds_left(now)
    return count if left is None else f"{count}  {duration(left)} left"


def _facts(facts: Mapping[str, float | str]) -> str:
    return "  ".join(
        f"{name.replace('_', ' ')} {number(value)}" for name, value in facts.items() if name not in _TOLD_OTHERWISE
    )
