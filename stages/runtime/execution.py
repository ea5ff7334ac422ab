"""Make the artifact of a stage call: find it, make it here in a process of its own, or have another machine make it."""

from __future__ import annotations

import logging
from dataclasses import dataclass

from juicer.artifacts.draft import Draft
from juicer.artifacts.manifest import Manifest
from juicer.artifacts.ref import ArtifactRef
from stages.runtime.context import StageContext, StageInterrupted
from stages.runtime.given_files import check_unchanged
from stages.runtime.isolation import Work, run_isolated
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


def is_reused(call: StageCall, session: Session) -> bool:
    """Whether the artifact is in the store, and is not to be made again all the same."""
    forced = call.stage.name in session.forced and call.recipe.id not in session.fresh
    return not forced and session.store.find(call.recipe) is not None


def execute(call: StageCall, session: Session) -> Finished:
    """Make the artifact now, in this thread, unless it is in the store."""
    stage, label = call.stage.name, session.label
    if is_reused(call, session):
        return _finish(call, session, Finished(call.recipe.ref, reused=True))
    try:
        adopted = _make(call, session, replacing=session.store.find(call.recipe) is not None)
    except BaseException as error:
        state = "stopped" if isinstance(error, StageInterrupted) else "failed"
        session.display.finished(stage, label, state, {"reason": str(error)})
        raise
    return _finish(call, session, Finished(call.recipe.ref, reused=adopted))


def _make(call: StageCall, session: Session, replacing: bool) -> bool:
    """Have the artifact made; returns whether somebody else has made it in the meantime."""
    # Files from outside the store are on this machine only.
    if session.send is not None and not call.recipe.files:
        session.display.started(call.stage.name, session.label)
        session.send(call, session)
        return False
    with session.store.create(call.recipe, replacing=replacing) as draft:
        if not draft.adopted:
            _fill(call, session, draft)
            check_unchanged(call.recipe.files, call.stage.describe_files(call.arguments))
    return draft.adopted


def _fill(call: StageCall, session: Session, draft: Draft) -> None:
    listener = session.display.started(call.stage.name, session.label)

    def progress(done: int, total: int, **facts: float | str) -> None:
        if session.stop.is_set():
            raise StageInterrupted
        listener(done, total, **facts)

    metrics = session.record.metrics(call.stage.name)
    logger.info("%s%s: making %s", call.stage.name, f" ({session.label})" if session.label else "", draft.ref)
    if not session.isolate:
        context = StageContext(
            session.store, draft, progress, metrics, session.workers, session.num_envs, session.device
        )
        call.stage.body(context, **call.arguments)
        return
    work = Work(
        module=call.stage.body.__module__,
        name=call.stage.name,
        modules=call.recipe.modules,
        arguments=call.arguments,
        store=session.store,
        ref=draft.ref,
        path=draft.path,
        scratch=draft.scratch,
        workers=session.workers,
        num_envs=session.num_envs,
        device=session.device,
    )
    draft.summary.update(run_isolated(work, progress, metrics, session.stop))


def _finish(call: StageCall, session: Session, finished: Finished) -> Finished:
    session.fresh.add(finished.ref.id)
    manifest = session.store.manifest(finished.ref)
    state = "reused" if finished.reused else "done"
    session.display.finished(call.stage.name, session.label, state, manifest.summary)
    logger.info("%s: %s %s %s", call.stage.name, state, finished.ref, brief(manifest))
    return finished


def brief(manifest: Manifest) -> str:
    """The plain facts of a summary on one line."""
    facts = {key: value for key, value in manifest.summary.items() if isinstance(value, int | float | str)}
    return ", ".join(
        f"{key} {value:.4g}" if isinstance(value, float) else f"{key} {value}" for key, value in facts.items()
    )
