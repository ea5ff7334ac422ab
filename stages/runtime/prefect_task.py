"""A stage call as a Prefect task run: here, or on the workers of the task runner of the flow run around it."""

from __future__ import annotations

import threading
from collections import defaultdict
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import cache
from typing import Any
from uuid import UUID

from prefect import Task, get_client, task
from prefect.cache_policies import NO_CACHE
from prefect.client.schemas.objects import State, StateType, TaskRun
from prefect.futures import PrefectFuture
from prefect.runtime import flow_run
from prefect.states import Cancelled, Completed
from prefect.utilities.annotations import quote

from juicer.artifacts.ref import ArtifactRef
from juicer.errors import ArtifactError, StageDied, StoreUnreachable
from juicer.progress import Progress
from stages.runtime.cluster import Opener, Order
from stages.runtime.context import SilentDisplay, StageInterrupted
from stages.runtime.execution import Finished, execute, fail, finish, is_reused
from stages.runtime.prefect_display import PrefectDisplay, attempt, shown_percent
from stages.runtime.session import Session
from stages.runtime.stage import StageCall

REUSED = "Reused"
REUSED_SUFFIX = " (reused)"
POLL_SECONDS = 2.0
TRANSIENT = (ConnectionError, TimeoutError, StoreUnreachable)
"""What may pass by itself: a store or server that does not answer. Everything else fails the same way again."""


class PrefectPerformer:
    """Submits stage calls to the task runner of the flow run around it, and waits for them.

    Calls for one id wait for each other outside the task runner, so that none occupies a worker in vain.
    """

    def __init__(self, opener: Opener | None = None) -> None:
        """Run calls in this process, or, with an opener, on the workers of a cluster.

        Args:
            opener: Opens a store on a worker.
        """
        self._opener = opener
        self._locks: defaultdict[str, threading.Lock] = defaultdict(threading.Lock)
        self._states: dict[ArtifactRef, State[Any]] = {}

    def __call__(self, call: StageCall, session: Session) -> ArtifactRef:
        """Run a call as a Prefect task.

        Raises:
            StageInterrupted: If the user asked for an end.
            StageDied: If the worker that ran it died, again and again.
        """
        upstream = [self._states[ref] for ref in call.recipe.parents if ref in self._states]
        with self._locks[call.recipe.id]:
            if session.stop.is_set():
                raise StageInterrupted
            name, is_there = f"{call.stage.name} {session.label}".strip(), False
            # The graph shows names and, for both, the colour of what has completed.
            with suppress(*TRANSIENT, ArtifactError):  # the task itself finds out, and tries again
                is_there = is_reused(call, session)
            name += REUSED_SUFFIX if is_there else ""
            try:
                # Files from outside the store are on this machine only.
                if self._opener and not is_there and not call.recipe.files:
                    state = _on_a_worker(name, Order(call, session, self._opener), session, upstream)
                else:
                    state = _here(name, call, session, upstream, at_once=self._opener is not None)
            except Exception:
                if session.stop.is_set():
                    raise StageInterrupted from None
                raise
            except BaseException:
                # An interrupt reaches the thread that waits; the stage's own is to hear of it.
                session.stop.set()
                raise
            self._states[call.recipe.ref] = state
            return call.recipe.ref


def _here(name: str, call: StageCall, session: Session, upstream: list[State[Any]], *, at_once: bool) -> State[Any]:
    """Make an artifact in this process: in this thread, or when a thread of the task runner is free."""
    prefect_task = _task(_make, call.stage.name, call.stage.description).with_options(task_run_name=name)
    if at_once:
        state: State[Any] = prefect_task(quote(call), quote(session), wait_for=upstream, return_state=True)
        state.result()
        return state
    future: PrefectFuture[Any] = prefect_task.submit(quote(call), quote(session), wait_for=upstream)
    future.result()
    return future.state


def _on_a_worker(name: str, order: Order, session: Session, upstream: list[State[Any]]) -> State[Any]:
    """Have a worker make an artifact, and show meanwhile how far it is."""
    call, display = order.call, session.display
    prefect_task = _task(_make_on_order, call.stage.name, call.stage.description).with_options(task_run_name=name)
    progress: Progress | None = None
    future: PrefectFuture[Any] = prefect_task.submit(order, wait_for=upstream)
    try:
        while not _is_over(future):
            if session.stop.is_set():
                raise StageInterrupted
            if (percent := shown_percent(call.stage.name, session.label)) is not None:
                progress = progress or display.started(call.stage.name, session.label, str(call.recipe.ref))
                progress(round(percent), 100)
    except BaseException as error:
        fail(call, session, error)
        raise
    if session.store.find(call.recipe) is None:
        raise ArtifactError(
            f"a worker has made {call.recipe.ref}, but not in '{session.store.url}'; "
            "set JUICER_STORE to one place that all machines reach"
        )
    finish(call, session, Finished(call.recipe.ref, reused=future.state.name == REUSED))
    return future.state


def _is_over(future: PrefectFuture[Any]) -> bool:
    """Whether a task is done, after waiting for a while; raises what it raised."""
    try:
        future.result(timeout=POLL_SECONDS)
    except TimeoutError as error:
        # That of Prefect names the task; any other is the stage's own.
        if str(future.task_run_id) in str(error):
            return False
        raise
    except Exception as error:
        if type(error).__module__.partition(".")[0] in ("distributed", "ray"):
            raise StageDied(
                f"the workers that a stage was given to died ({type(error).__name__}); their machines may have run out "
                "of memory; run it again to continue"
            ) from None
        raise
    return True


@cache
def _task(function: Callable[..., Any], name: str, description: str) -> Task[..., Any]:
    # The artifact store is the only cache: Prefect's own would neither see changed files nor changed helpers.
    return task(
        name=name,
        description=description,
        cache_policy=NO_CACHE,
        persist_result=False,
        retries=2,
        retry_delay_seconds=[5, 30],
        retry_condition_fn=_may_pass,
    )(function)


def _make(call: StageCall, session: Session) -> ArtifactRef | State[Any]:
    return _told(lambda: execute(call, replace(session, display=PrefectDisplay(session.display))))


def _make_on_order(order: Order) -> ArtifactRef | State[Any]:
    """On a worker, which learns from Prefect that nobody waits for it any more."""
    stop, run_id = threading.Event(), flow_run.get_id()

    def look() -> None:
        if attempt(_is_abandoned, run_id=run_id):
            stop.set()

    return _told(lambda: order.execute(PrefectDisplay(SilentDisplay(), look), stop))


def _is_abandoned(run_id: str) -> bool:
    """Whether a flow run is over, or about to be."""
    with get_client(sync_client=True) as client:
        state = client.read_flow_run(UUID(run_id)).state
    return state is not None and (state.is_final() or state.type is StateType.CANCELLING)


def _told(make: Callable[[], Finished]) -> ArtifactRef | State[Any]:
    try:
        finished = make()
    except StageInterrupted:
        return Cancelled(message="interrupted by the user")
    return Completed(name=REUSED, data=finished.ref) if finished.reused else finished.ref


def _may_pass(task: Task[Any, Any], task_run: TaskRun, state: State[Any]) -> bool:
    error = state.result(raise_on_failure=False)
    while isinstance(error, BaseException):
        if isinstance(error, TRANSIENT):
            return True
        error = error.__cause__
    return False
