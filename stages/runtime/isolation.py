"""Run a stage body in a process of its own.

Stages that run side by side would share torch's global switches, the interpreter lock and the memory of finished
stages; an interrupt would have to wait for the body. In a process of its own, none of this happens. The process
ends with its parent, whatever ends the parent. A process pool does none of the last three: its workers outlive a
killed parent, cannot be interrupted one by one, and have no way to report before they are done.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
import traceback
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerContext
from typing import Any

from juicer.artifacts.code_version import home_of
from juicer.errors import ForeignCode, StageDied
from juicer.progress import NullMetricSink, silent_progress
from stages.runtime.context import StageContext, StageInterrupted
from stages.runtime.names import STAGES
from stages.runtime.socket_folder import make_socket_folder
from stages.runtime.stage import StageCall, unlike_recipe

PRELOADED = (
    "torch",
    "mujoco",
    "numcodecs.blosc",
    "pyarrow.parquet",
    "juicer.policy.checkpoint",
    "juicer.training.trainer",
    "juicer.reporting.page",
    "juicer.reporting.videos",
    *(f"stages.{name}" for name in STAGES),
    # Last: it notes what all of the above was when it was imported.
    "stages.runtime.loaded_code",
)
"""Imported once, by the process from which all stage processes are forked: it saves their time, and code that is
edited during a run does not become part of it."""

REPORT_SECONDS = 0.1
POLL_SECONDS = 0.2
FAREWELL_SECONDS = 5.0
"""How long a process that has done its work may take to end; threads of libraries may hold it up."""
_LOGGERS = ("juicer", "stages")


def warm_up() -> None:
    """Begin to import what the stages need, in the background, before the first of them runs.

    Raises:
        ServiceUnavailable: If there is no place for temporary files.
    """
    # The process that everything is forked from starts with the first one that is asked for.
    _forking().Process(target=int, daemon=True).start()


def run_isolated(call: StageCall, context: StageContext, stop: threading.Event) -> dict[str, Any]:
    """Run a body in a process of its own and return the summary it leaves.

    Args:
        call: Whose body.
        context: What the body works with; its listeners hear what the process reports.
        stop: Ends the process when it is set.

    Raises:
        StageInterrupted: If ``stop`` was set; the process is gone then.
        StageDied: If the process ended without a word, as when the system runs out of memory.
        Exception: Whatever the body raised.
    """
    forking, name = _forking(), call.recipe.stage
    receiving, sending = forking.Pipe(duplex=False)
    guarded, guard = forking.Pipe(duplex=False)
    told = replace(context, progress=silent_progress, metrics=NullMetricSink())
    process = forking.Process(target=_work, args=(call, told, sending, guarded), name=name, daemon=False)
    process.start()
    sending.close()
    guarded.close()
    try:
        summary = _listen(receiving, context, stop)
        process.join(FAREWELL_SECONDS)
        return summary
    except EOFError:
        # An interrupt may reach the new process before it has learned to leave that to its parent.
        if stop.wait(POLL_SECONDS):
            raise StageInterrupted from None
        process.join()
        raise StageDied(_obituary(name, process.exitcode)) from None
    finally:
        # Gently, if it lets itself.
        process.terminate()
        process.join(FAREWELL_SECONDS)
        process.kill()
        process.join()
        guard.close()
        receiving.close()


@cache
def _forking() -> ForkServerContext:
    make_socket_folder()
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(list(PRELOADED))
    return context


def _listen(receiving: Connection, context: StageContext, stop: threading.Event) -> dict[str, Any]:
    while True:
        if stop.is_set():
            raise StageInterrupted
        if not receiving.poll(POLL_SECONDS):
            continue
        kind, content = receiving.recv()
        if kind == "progress":
            done, total, facts = content
            context.progress(done, total, **facts)
        elif kind == "metrics":
            context.metrics.log(*content)
        elif kind == "log":
            logging.getLogger(content.name).handle(content)
        elif kind == "error":
            raise content
        else:
            summary: dict[str, Any] = content
            return summary


def _obituary(name: str, status: int | None) -> str:
    if status is not None and status < 0:
        cause = signal.Signals(-status).name
        hint = "; the machine may have run out of memory" if -status == signal.SIGKILL else ""
        return f"the process of stage '{name}' was ended by {cause}{hint}; run it again to continue"
    return f"the process of stage '{name}' ended with status {status} before its work was done"


def _work(call: StageCall, context: StageContext, sending: Connection, guarded: Connection) -> None:
    # An interrupt from the keyboard reaches every process; only the parent decides what it means.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(1))
    threading.Thread(target=_end_with_parent, args=(guarded,), daemon=True).start()
    voice = _Voice(sending)
    for name in _LOGGERS:
        logger = logging.getLogger(name)
        logger.handlers, logger.propagate = [_Forwarder(voice)], False
        logger.setLevel(logging.INFO)
    try:
        stage = call.stage
        check_code(call)
        stage.body(replace(context, progress=voice.progress, metrics=voice), **call.arguments)
        voice.say("summary", context.draft.summary)
    except Exception as error:
        voice.say("error", portable(error, call.recipe.stage))
    sending.close()


def check_code(call: StageCall) -> None:
    """Refuse to make an artifact with other code, or other tasks, than those its recipe names.

    Raises:
        ForeignCode: Naming what differs.
    """
    changed = unlike_recipe(call.module, call.recipe)
    if changed:
        raise ForeignCode(
            f"stage '{call.recipe.stage}' would run other code than its artifact is to be known by ({changed[0]} in "
            f"'{home_of(call.module)}' differs): it was edited while the run started, or another copy of juicer stands "
            "before this one; run the command again, and see that PYTHONPATH names no other copy"
        )


def portable(error: Exception, stage: str) -> Exception:
    """The error with where it arose, or its text if it is one of those that survive no pickling."""
    error.add_note(f"In the process of stage '{stage}':\n{traceback.format_exc()}")
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError("\n".join([repr(error), *error.__notes__]))
    return error


def _end_with_parent(guarded: Connection) -> None:
    try:
        guarded.recv()
    except EOFError:
        os._exit(1)


class _Voice:
    """The working process's way to tell its parent: progress listener and metric sink."""

    def __init__(self, sending: Connection) -> None:
        self._sending = sending
        self._lock = threading.Lock()
        self._due = 0.0

    def say(self, kind: str, content: Any) -> None:
        with self._lock:
            self._sending.send((kind, content))

    def progress(self, done: int, total: int, **facts: float | str) -> None:
        now = time.monotonic()
        if now >= self._due or done == total:
            self._due = now + REPORT_SECONDS
            self.say("progress", (done, total, facts))

    def log(self, metrics: Mapping[str, float], step: int) -> None:
        self.say("metrics", (dict(metrics), step))


class _Forwarder(logging.Handler):
    def __init__(self, voice: _Voice) -> None:
        super().__init__()
        self._voice = voice

    def emit(self, record: logging.LogRecord) -> None:
        record.msg, record.args, record.exc_info = record.getMessage(), None, None
        self._voice.say("log", record)
