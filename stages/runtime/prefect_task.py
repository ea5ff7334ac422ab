"""A stage call as a Prefect task run: its states, retries, progress and summary in Prefect's UI."""

from __future__ import annotations

import logging
import re
import threading
import time
from collections import defaultdict
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from functools import cache
from typing import Any
from uuid import UUID

from prefect import Task, task
from prefect.artifacts import create_markdown_artifact, create_progress_artifact, update_progress_artifact
from prefect.cache_policies import NO_CACHE
from prefect.client.schemas.objects import State, TaskRun
from prefect.futures import PrefectFuture
from prefect.states import Cancelled, Completed
from prefect.utilities.annotations import quote

from juicer.artifacts.ref import ArtifactRef
from juicer.errors import ArtifactError
from juicer.progress import Progress
from stages.runtime.context import Display, StageInterrupted
from stages.runtime.execution import execute, is_reused
from stages.runtime.session import Session
from stages.runtime.stage import StageCall

logger = logging.getLogger(__name__)

REUSED = "Reused"
REUSED_SUFFIX = " (reused)"
UPDATE_SECONDS = 5.0
TRANSIENT = (ConnectionError, TimeoutError)
"""What may pass by itself: a store or server that does not answer. Everything else fails the same way again."""


class PrefectPerformer:
    """Submits stage calls to the task runner of the flow run around it, and waits for them.

    Calls for one id wait for each other outside the task runner, so that none occupies a worker in vain.
    """

    def __init__(self) -> None:
        self._locks: defaultdict[str, threading.Lock] = defaultdict(threading.Lock)
        self._futures: dict[ArtifactRef, PrefectFuture[Any]] = {}

    def __call__(self, call: StageCall, session: Session) -> ArtifactRef:
        """Run a call as a Prefect task.

        Raises:
            StageInterrupted: If the user asked for an end.
        """
        upstream = [self._futures[ref] for ref in call.recipe.parents if ref in self._futures]
        with self._locks[call.recipe.id]:
            if session.stop.is_set():
                raise StageInterrupted
            name = f"{call.stage.name} {session.label}".strip()
            # The graph shows names and, for both, the colour of what has completed.
            with suppress(*TRANSIENT, ArtifactError):  # the task itself finds out, and tries again
                name += REUSED_SUFFIX if is_reused(call, session) else ""
            prefect_task = _task(call.stage.name, call.stage.description).with_options(task_run_name=name)
            future = prefect_task.submit(
                call=quote(call), session=quote(session), return_state=False, wait_for=upstream
            )
            try:
                ref: ArtifactRef = future.result()
            except Exception:
                if session.stop.is_set():
                    raise StageInterrupted from None
                raise
            except BaseException:
                # An interrupt reaches the thread that waits; the stage's own is to hear of it.
                session.stop.set()
                raise
            self._futures[ref] = future
            return ref


@cache
def _task(name: str, description: str) -> Task[[StageCall, Session], Any]:
    # The artifact store is the only cache: Prefect's own would neither see changed files nor changed helpers.
    return task(
        name=name,
        description=description,
        cache_policy=NO_CACHE,
        persist_result=False,
        retries=2,
        retry_delay_seconds=[5, 30],
        retry_condition_fn=_may_pass,
    )(_run)


def _run(call: StageCall, session: Session) -> ArtifactRef | State[Any]:
    try:
        finished = execute(call, replace(session, display=_PrefectDisplay(session.display)))
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


class _PrefectDisplay:
    """Repeats to Prefect's UI what is shown to the user."""

    def __init__(self, inner: Display) -> None:
        self._inner = inner
        self._progress: UUID | None = None

    def started(self, stage: str, label: str) -> Progress:
        listener = self._inner.started(stage, label)
        self._progress = _attempt(
            create_progress_artifact, progress=0.0, key=_key(stage, label, "progress"), description=f"{stage} {label}"
        )
        due = time.monotonic() + UPDATE_SECONDS

        def progress(done: int, total: int, **facts: float | str) -> None:
            nonlocal due
            listener(done, total, **facts)
            if self._progress and total and time.monotonic() >= due:
                _attempt(update_progress_artifact, artifact_id=self._progress, progress=100.0 * done / total)
                due = time.monotonic() + UPDATE_SECONDS

        return progress

    def finished(self, stage: str, label: str, state: str, summary: Mapping[str, Any]) -> None:
        self._inner.finished(stage, label, state, summary)
        if self._progress and state == "done":
            _attempt(update_progress_artifact, artifact_id=self._progress, progress=100.0)
        if state == "done":
            _attempt(create_markdown_artifact, markdown=_table(summary), key=_key(stage, label, "summary"))


def _attempt(action: Any, **arguments: Any) -> Any:
    """What Prefect shows is not worth the work it shows: if its server is away, go on."""
    try:
        return action(**arguments)
    except Exception as error:
        logger.debug("Prefect took no artifact: %s", error)
        return None


def _key(*parts: str) -> str:
    return "-".join(re.sub(r"[^a-z0-9]+", "-", part.lower()).strip("-") for part in parts if part)


def _table(summary: Mapping[str, Any]) -> str:
    rows = "\n".join(f"| {key} | {value} |" for key, value in summary.items())
    return f"| fact | value |\n| --- | --- |\n{rows}\n"
