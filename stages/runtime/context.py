"""What a stage body works with, and who listens to it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from juicer.artifacts.draft import Draft
from juicer.artifacts.store import ArtifactStore
from juicer.progress import MetricSink, NullMetricSink, Progress, silent_progress
from stages.runtime.machine import Machine


class StageInterrupted(BaseException):
    """The user asked for an end while a stage was at work. Not an error: nothing is retried or reported."""


@dataclass(frozen=True)
class StageContext:
    """What a stage body works with.

    Attributes:
        store: To open the inputs.
        draft: To fill.
        progress: To report to, often: an interrupt takes effect at the next report.
        metrics: Where numbers that form curves go.
        machine: How much of the machine may be used; must not shape the result.
    """

    store: ArtifactStore
    draft: Draft
    progress: Progress
    metrics: MetricSink
    machine: Machine


class Display(Protocol):
    """Shows people which stages run and how far they are."""

    def started(self, stage: str, label: str, artifact: str) -> Progress:
        """A stage begins to make an artifact; whoever gets the listener reports its advance to it."""
        ...

    def finished(self, stage: str, label: str, artifact: str, state: str, summary: Mapping[str, Any]) -> None:
        """A stage is over: ``done``, ``reused``, ``failed`` or ``stopped``."""
        ...

    def settled(self, label: str) -> None:
        """Nothing more is to come for a condition and seed, whatever was expected."""
        ...


class Record(Protocol):
    """Keeps what an experiment consists of, for people to look at later; nothing is ever read back from it."""

    def metrics(self, stage: str) -> MetricSink:
        """Where the curves of a stage go while it runs."""
        ...

    def for_round(self, turn: int) -> Record:
        """The record of one turn of collect, select, train."""
        ...


class SilentDisplay:
    """Display that shows nothing."""

    def started(self, stage: str, label: str, artifact: str) -> Progress:
        """Nobody looks."""
        return silent_progress

    def finished(self, stage: str, label: str, artifact: str, state: str, summary: Mapping[str, Any]) -> None:
        """Nobody looks."""

    def settled(self, label: str) -> None:
        """Nobody looks."""


class NoRecord:
    """Record that keeps nothing."""

    def metrics(self, stage: str) -> MetricSink:
        """Drop the curves."""
        return NullMetricSink()

    def for_round(self, turn: int) -> NoRecord:
        """Nothing is kept of any turn."""
        return self
