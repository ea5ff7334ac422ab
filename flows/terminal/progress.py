"""Progress in the terminal: live lines where there is a terminal, plain lines now and then where there is none."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from statistics import fmean
from types import TracebackType
from typing import Any, Self

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from flows.terminal.headline import duration, headline, number, rejections
from juicer.progress import Progress

REFRESHES_PER_SECOND = 4
PLAIN_SECONDS = 15.0
BAR_WIDTH = 24
_MARKS = {"done": ("✓", "green"), "reused": ("↺", "cyan"), "failed": ("✗", "red"), "stopped": ("■", "yellow")}


@dataclass
class _Line:
    """One running stage."""

    stage: str
    label: str
    started: float = field(default_factory=time.monotonic)
    done: int = 0
    total: int = 0
    facts: dict[str, float | str] = field(default_factory=dict)
    spoken: float = 0.0

    @property
    def seconds(self) -> float:
        return time.monotonic() - self.started

    @property
    def seconds_left(self) -> float | None:
        if "seconds_left" in self.facts:
            return float(self.facts["seconds_left"])
        return self.seconds / self.done * (self.total - self.done) if self.done and self.total else None


class Board:
    """Shows which stages run, how far they are, and how long the rest may take; to be used in a ``with`` statement."""

    def __init__(self, console: Console | None = None, workers: int = 1) -> None:
        """Show on a console, standard error by default."""
        self.console = console or Console(stderr=True, highlight=False)
        self._workers = workers
        self._lock = threading.RLock()
        self._running: dict[tuple[str, str], _Line] = {}
        self._expected: list[tuple[str, str]] = []
        self._seconds: dict[str, list[float]] = {}
        self._started = time.monotonic()
        self._finished = 0
        self._live: Live | None = None

    def __enter__(self) -> Self:
        """Begin to show."""
        if self.console.is_terminal:
            self._live = Live(
                console=self.console,
                get_renderable=self._render,
                refresh_per_second=REFRESHES_PER_SECOND,
                transient=True,
            )
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Leave nothing but the lines of finished stages."""
        if self._live:
            self._live.stop()

    def expect(self, calls: Sequence[tuple[str, str]], seconds: Mapping[str, float]) -> None:
        """Learn which stages are to come, by name and label, and how long they took when they last ran."""
        with self._lock:
            self._expected = list(calls)
            self._seconds = {stage: [value] for stage, value in seconds.items()}

    def say(self, message: str) -> None:
        """Print a line that stays."""
        self.console.print(message, markup=False, soft_wrap=True)

    def started(self, stage: str, label: str) -> Progress:
        """A stage begins."""
        line = _Line(stage, label)
        with self._lock:
            self._running[stage, label] = line
        if not self._live:
            self.say(f"{_clock()}  {stage:9} {label:24} begins")

        def progress(done: int, total: int, **facts: float | str) -> None:
            with self._lock:
                line.done, line.total, line.facts = done, total, dict(facts)
                if not self._live and time.monotonic() - max(line.spoken, line.started) >= PLAIN_SECONDS:
                    line.spoken = time.monotonic()
                    self.say(f"{_clock()}  {self._plain(line)}")

        return progress

    def finished(self, stage: str, label: str, state: str, summary: Mapping[str, Any]) -> None:
        """A stage is over."""
        with self._lock:
            line = self._running.pop((stage, label), None)
            if (stage, label) in self._expected:
                self._expected.remove((stage, label))
            if state == "done" and line:
                self._seconds.setdefault(stage, []).append(line.seconds)
            self._finished += state in ("done", "reused")
            mark, colour = _MARKS[state]
            took = f"{duration(line.seconds):>8}" if line else f"{state:>8}"
            text = f"{_clock()}  {mark} {stage:9} {label:24} {took}  {headline(summary)}"
            self.console.print(Text(text.rstrip(), style=colour if state == "failed" else ""), soft_wrap=True)
            for rejection in rejections(summary) if state == "done" else ():
                self.say(f"            {rejection}")

    def seconds_left(self) -> tuple[float, bool]:
        """Wall time until everything expected is done, and whether nothing is missing in that estimate."""
        with self._lock:
            left = [line.seconds_left for line in self._running.values()]
            waiting = [stage for stage, label in self._expected if (stage, label) not in self._running]
            known = [fmean(self._seconds[stage]) for stage in waiting if stage in self._seconds]
        certain = [seconds for seconds in left if seconds is not None]
        total = (sum(certain) + sum(known)) / self._workers
        return max([total, *certain]), len(known) == len(waiting) and None not in left

    def _render(self) -> RenderableType:
        with self._lock:
            table = Table.grid(padding=(0, 1))
            for line in self._running.values():
                bar = ProgressBar(
                    total=line.total or 1,
                    completed=line.done,
                    width=BAR_WIDTH,
                    pulse=not line.total,
                    animation_time=time.monotonic(),
                )
                table.add_row(line.stage, line.label, bar, _count(line), _left(line), Text(_facts(line), style="dim"))
            return Group(table, Text(self._total(), style="dim"))

    def _plain(self, line: _Line) -> str:
        return f"{line.stage:9} {line.label:24} {_count(line)}  {_left(line)}  {_facts(line)}; {self._total()}"

    def _total(self) -> str:
        seconds, complete = self.seconds_left()
        waiting = len(self._expected)
        so_far = f"{duration(time.monotonic() - self._started)} so far, {self._finished} stages done"
        if not waiting:
            return so_far
        if seconds < 1 and not complete:
            return f"{so_far}, {waiting} to go"
        about = "about" if complete else "more than"
        return f"{so_far}, {waiting} to go, {about} {duration(seconds)} left"


def _clock() -> str:
    return time.strftime("%H:%M:%S")


def _count(line: _Line) -> str:
    if not line.total:
        return f"{line.done}" if line.done else "begins"
    return f"{line.done}/{line.total} {line.done / line.total:4.0%}"


def _left(line: _Line) -> str:
    seconds = line.seconds_left
    return "" if seconds is None else f"{duration(seconds)} left"


def _facts(line: _Line) -> str:
    return "  ".join(f"{name} {number(value)}" for name, value in line.facts.items() if name != "seconds_left")
