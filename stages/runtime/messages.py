"""Messages of a process that does the work of a stage to its parent; it ends with that, whatever ends the parent."""

from __future__ import annotations

import logging
import os
import pickle
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Mapping
from dataclasses import replace
from multiprocessing.connection import Connection
from typing import Any

from juicer.progress import NullMetricSink, silent_progress
from stages.runtime.context import StageContext

REPORT_SECONDS = 0.1
_LOGGERS = ("juicer", "stages")

Message = tuple[str, Any]
"""A kind (``progress``, ``metrics``, ``log``, ``error`` or ``draft``), and what is told."""


def without_listeners(context: StageContext) -> StageContext:
    """The context as it can be sent to a process, whose listeners are here."""
    return replace(context, progress=silent_progress, metrics=NullMetricSink())


def work_for_parent(
    work: Callable[[StageContext], None], context: StageContext, sending: Connection, guarded: Connection, stage: str
) -> bool:
    """Do the work of a stage's process; its progress, its result or its error are sent.

    Args:
        work: What is to be done.
        context: What it works with; its listeners are replaced by the parent's.
        sending: Where the parent listens.
        guarded: Breaks when the parent ends.
        stage: Name of the stage.

    Returns:
        Whether it was done.
    """
    # An interrupt from the keyboard reaches every process; only the parent decides what it means.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(1))
    threading.Thread(target=_end_with_parent, args=(guarded,), daemon=True).start()
    sender = _Sender(sending)
    for name in _LOGGERS:
        logger = logging.getLogger(name)
        logger.handlers, logger.propagate = [_LogSender(sender)], False
        logger.setLevel(logging.INFO)
    try:
        work(replace(context, progress=sender.progress, metrics=sender))
        sender.send("draft", context.draft)
        done = True
    except Exception as error:
        sender.send("error", portable(error, stage))
        done = False
    sending.close()
    return done


def forward(message: Message, context: StageContext) -> None:
    """Have the listeners of a context hear what a process told."""
    kind, content = message
    if kind == "progress":
        done, total, facts = content
        context.progress(done, total, **facts)
    elif kind == "metrics":
        context.metrics.log(*content)
    elif kind == "log":
        logging.getLogger(content.name).handle(content)


def portable(error: Exception, stage: str) -> Exception:
    """The error with where it arose, or its text if it is one of those that survive no pickling."""
    error.add_note(f"In the process of stage '{stage}':\n{traceback.format_exc()}")
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError("\n".join([repr(error), *error.__notes__]))
    return error


def describe_end(process: str, status: int | None) -> str:
    """What is to be said of a process that ended without a word."""
    if status is not None and status < 0:
        cause = signal.Signals(-status).name
        hint = "; the machine may have run out of memory" if -status == signal.SIGKILL else ""
        return f"{process} was ended by {cause}{hint}; run it again to continue"
    with_status = "" if status is None else f" with status {status}"
    return f"{process} ended{with_status} before its work was done; run it again to continue"


def _end_with_parent(guarded: Connection) -> None:
    try:
        guarded.recv()
    except EOFError:
        os._exit(1)


class _Sender:
    """The working process's way to tell its parent: progress listener and metric sink."""

    def __init__(self, sending: Connection) -> None:
        self._sending = sending
        self._lock = threading.Lock()
        self._due = 0.0

    def send(self, kind: str, content: Any) -> None:
        with self._lock:
            self._sending.send((kind, content))

    def progress(self, done: int, total: int, **facts: float | str) -> None:
        now = time.monotonic()
        if now >= self._due or done == total:
            self._due = now + REPORT_SECONDS
            self.send("progress", (done, total, facts))

    def log(self, metrics: Mapping[str, float], step: int) -> None:
        self.send("metrics", (dict(metrics), step))


class _LogSender(logging.Handler):
    def __init__(self, sender: _Sender) -> None:
        super().__init__()
        self._sender = sender

    def emit(self, record: logging.LogRecord) -> None:
        record.msg, record.args, record.exc_info = record.getMessage(), None, None
        self._sender.send("log", record)
