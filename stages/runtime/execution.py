"""Make the artifact of a stage call: find it in the store, or run the stage's body."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from functools import cached_property

from juicer.artifacts.draft import Draft
from juicer.artifacts.ref import ArtifactRef
from juicer.progress import Progress
from stages.runtime.context import StageContext, StageInterrupted
from stages.runtime.given_files import check_unchanged
from stages.runtime.isolation import run_isolated
from stages.runtime.machine import Machine
from stages.runtime.ranks import run_body
from stages.runtime.session import Session
from stages.runtime.stage import StageCall

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Finished:
    """How a stage call ended."""

    ref: ArtifactRef
    reused: bool


def perform_here(call: StageCall, session: Session) -> ArtifactRef:
    """Run a stage at once, in this thread."""
    return execute(call, session).ref


def is_forced(call: StageCall, session: Session) -> bool:
    """Whether the artifact is to be made even if it is in the store."""
    return call.stage.name in session.forced and call.recipe.id not in session.fresh


def is_reused(call: StageCall, session: Session) -> bool:
    """Whether the artifact is in the store, and is not to be made again all the same."""
    return not is_forced(call, session) and session.store.find(call.recipe) is not None


def execute(call: StageCall, session: Session) -> Finished:
    """Make the artifact now, in this thread, unless it is in the store.

    Raises:
        StageInterrupted: If the user asked for an end.
    """
    if is_reused(call, session):
        return finish(call, session, Finished(call.recipe.ref, reused=True))
    if session.stop.is_set():
        # A call may have waited for a thread of the task runner meanwhile; it does not begin any more.
        raise StageInterrupted
    replacing = session.store.find(call.recipe) is not None
    progress = _Progress(call, session)
    try:
        with session.store.create(call.recipe, replacing=replacing, waiting=progress.waiting) as draft:
            if not draft.adopted:
                _fill(call, session, draft, progress)
                check_unchanged(call.recipe.files, call.stage.describe_files(call.arguments))
    except BaseException as error:
        fail(call, session, error)
        raise
    return finish(call, session, Finished(call.recipe.ref, reused=draft.adopted))


class _Progress:
    """Tells how far a call has come, from when it has something to tell, and ends it when the user asked for an end."""

    def __init__(self, call: StageCall, session: Session) -> None:
        self._call, self._session = call, session

    @cached_property
    def _listener(self) -> Progress:
        return self._session.display.started(self._call.stage.name, self._session.label, str(self._call.recipe.ref))

    def begin(self) -> None:
        """Tell that the work begins."""
        label = self._session.label
        name = f"{self._call.stage.name}{f' ({label})' if label else ''}"
        logger.info("%s: making %s", name, self._call.recipe.ref)
        _ = self._listener

    def __call__(self, done: int, total: int, **facts: float | str) -> None:
        if self._session.stop.is_set():
            raise StageInterrupted
        self._listener(done, total, **facts)

    def waiting(self) -> None:
        """Tell that another process makes the artifact."""
        self(0, 0, waiting_for="another run")


def _fill(call: StageCall, session: Session, draft: Draft, progress: _Progress) -> None:
    """Run the body; what it needs of the machine is its own meanwhile."""
    stage = call.stage
    progress.begin()

    def run(machine: Machine) -> None:
        metrics = session.record.metrics(stage.name)
        context = StageContext(session.store, draft, progress, metrics, machine)
        if session.isolate:
            run_isolated(call, context, session.stop)
        else:
            run_body(call, context)

    if need := stage.facts.needs:
        count = session.machine.processes if need == "devices" else 1
        devices = session.machine.devices
        waiting_for = " or ".join(devices) if count == 1 else f"{count} of {', '.join(devices)}"
        with session.machine.leased(lambda: progress(0, 0, waiting_for=waiting_for), count) as own:
            run(own)
    else:
        run(session.machine)
    draft.summary |= stage.facts.texts(draft.summary)


def fail(call: StageCall, session: Session, error: BaseException) -> None:
    """Tell that a call failed, or was interrupted."""
    state = "stopped" if isinstance(error, StageInterrupted) else "failed"
    artifact = str(call.recipe.ref)
    session.display.finished(call.stage.name, session.label, artifact, state, {"reason": str(error)})


def finish(call: StageCall, session: Session, finished: Finished) -> Finished:
    """Tell that the artifact of a call is there."""
    session.fresh.add(finished.ref.id)
    manifest = session.store.manifest(finished.ref)
    state = "reused" if finished.reused else "done"
    session.display.finished(call.stage.name, session.label, str(finished.ref), state, manifest.summary)
    logger.info("%s: %s %s %s", call.stage.name, state, finished.ref, manifest.headline)
    return finished
