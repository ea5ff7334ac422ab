"""What the stages of one flow run share: the store, who listens to them, and how much of the machine they may use."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Protocol, Self

from juicer.artifacts.draft import Draft
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.progress import MetricSink, NullMetricSink, Progress, silent_progress

if TYPE_CHECKING:
    from stages.stage import StageCall


ROUND = " round "


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
        workers: Threads or processes that may be kept busy; must not shape the result.
        num_envs: Simulated environments to step side by side; must not shape the result.
        device: Torch device that policies are trained on and act on.
    """

    store: ArtifactStore
    draft: Draft
    progress: Progress
    metrics: MetricSink
    workers: int = 1
    num_envs: int = 8
    device: str = "cpu"


class Display(Protocol):
    """Shows people which stages run and how far they are."""

    def started(self, stage: str, label: str) -> Progress:
        """A stage begins; whoever gets the listener reports its advance to it."""
        ...

    def finished(self, stage: str, label: str, state: str, summary: Mapping[str, Any]) -> None:
        """A stage is over: ``done``, ``reused``, ``failed`` or ``stopped``."""
        ...


class Record(Protocol):
    """Keeps what an experiment consists of, for people to look at later; nothing is ever read back from it."""

    def metrics(self, stage: str) -> MetricSink:
        """Where the curves of a stage go while it runs."""
        ...

    def made(self, ref: ArtifactRef, stage: str) -> None:
        """An artifact of the experiment is there, made now or before."""
        ...

    def for_round(self, turn: int) -> Record:
        """The record of one turn of collect, select, train."""
        ...


class SilentDisplay:
    """Display that shows nothing."""

    def started(self, stage: str, label: str) -> Progress:
        """Nobody looks."""
        return silent_progress

    def finished(self, stage: str, label: str, state: str, summary: Mapping[str, Any]) -> None:
        """Nobody looks."""


class NoRecord:
    """Record that keeps nothing."""

    def metrics(self, stage: str) -> MetricSink:
        """Drop the curves."""
        return NullMetricSink()

    def made(self, ref: ArtifactRef, stage: str) -> None:
        """Forget the artifact."""

    def for_round(self, turn: int) -> NoRecord:
        """Nothing is kept of any turn."""
        return self


def perform_here(call: StageCall, session: Session) -> ArtifactRef:
    """Run a stage at once, in this thread."""
    return call.execute(session).ref


@dataclass(frozen=True)
class Session:
    """Surroundings of a stage call; none of it shapes a result.

    Attributes:
        store: Where artifacts come from and go to.
        display: Shows progress.
        record: Keeps the experiment's history.
        perform: Runs a prepared call: at once, as a Prefect task, or only in thought.
        workers: Threads or processes a stage may keep busy.
        num_envs: Simulated environments a rollout steps side by side.
        device: Torch device that policies are trained on and act on.
        isolate: Whether each stage body gets a process of its own.
        send: Has an artifact made on another machine that shares the store; none if all are made here.
        label: Which condition, seed and round the calls are for.
        forced: Names of stages that are recomputed even if their artifact is in the store.
        stop: Set when the user asked for an end.
        fresh: Ids made since the session began; they satisfy ``forced``.
    """

    store: ArtifactStore
    display: Display = field(default_factory=SilentDisplay)
    record: Record = field(default_factory=NoRecord)
    perform: Callable[[StageCall, Session], ArtifactRef] = perform_here
    workers: int = 1
    num_envs: int = 8
    device: str = "cpu"
    isolate: bool = False
    send: Callable[[StageCall, Session], None] | None = None
    label: str = ""
    forced: frozenset[str] = frozenset()
    stop: threading.Event = field(default_factory=threading.Event)
    fresh: set[str] = field(default_factory=set)

    def for_model(self, label: str, record: Record) -> Self:
        """The same session for one condition and seed."""
        return replace(self, label=label, record=record)

    def for_round(self, turn: int) -> Self:
        """The same session for one turn of collect, select, train."""
        label = f"{self.label.partition(ROUND)[0]}{ROUND}{turn}"
        return replace(self, label=label, record=self.record.for_round(turn))
