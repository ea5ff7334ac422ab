"""Run a stage body in a process of its own.

Stages that run side by side would share torch's global switches, the interpreter lock and the memory of finished
stages; an interrupt would have to wait for the body. In a process of its own, none of this happens. The process
ends with its parent, whatever ends the parent. A process pool does none of the last three: its workers outlive a
killed parent, cannot be interrupted one by one, and have no way to report before they are done.
"""

from __future__ import annotations

import multiprocessing
import os
import threading
from functools import cache, partial
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerContext

from juicer.errors import StageDied
from stages.runtime.context import StageContext, StageInterrupted
from stages.runtime.messages import describe_end, forward, without_listeners, work_for_parent
from stages.runtime.names import STAGES
from stages.runtime.ranks import run_body
from stages.runtime.socket_folder import make_socket_folder
from stages.runtime.stage import StageCall

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

ALLOCATOR = ("GLIBC_TUNABLES", "glibc.malloc.hugetlb=1")
"""Variable, and its value, that lets glibc ask the kernel for huge pages: where memory is slow, a training step takes a
tenth to a third less time. Other C libraries ignore it."""

POLL_SECONDS = 0.2
SHUTDOWN_SECONDS = 5.0
"""How long a process that has done its work may take to end; threads of libraries may hold it up."""


def warm_up() -> None:
    """Begin to import what the stages need, in the background, before the first of them runs.

    Raises:
        ServiceUnavailable: If there is no place for temporary files.
    """
    # The process that everything is forked from starts with the first one that is asked for.
    _forking().Process(target=int, daemon=True).start()


def run_isolated(call: StageCall, context: StageContext, stop: threading.Event) -> None:
    """Run a body in a process of its own; the draft has its facts then.

    Args:
        call: Whose body.
        context: What the body works with; its listeners hear what the process reports.
        stop: Ends the process when it is set.

    Raises:
        StageInterrupted: If ``stop`` was set; the process is gone then.
        StageDied: If the process ended without a message, as when the system runs out of memory.
        Exception: Whatever the body raised.
    """
    forking, name = _forking(), call.recipe.stage
    receiving, sending = forking.Pipe(duplex=False)
    guarded, guard = forking.Pipe(duplex=False)
    process = forking.Process(
        target=_work, args=(call, without_listeners(context), sending, guarded), name=name, daemon=False
    )
    process.start()
    sending.close()
    guarded.close()
    try:
        _listen(receiving, context, stop)
        process.join(SHUTDOWN_SECONDS)
    except EOFError:
        # An interrupt may reach the new process before it has learned to leave that to its parent.
        if stop.wait(POLL_SECONDS):
            raise StageInterrupted from None
        process.join()
        raise StageDied(describe_end(f"the process of stage '{name}'", process.exitcode)) from None
    finally:
        # Gently, if it lets itself.
        process.terminate()
        process.join(SHUTDOWN_SECONDS)
        process.kill()
        process.join()
        guard.close()
        receiving.close()


@cache
def _forking() -> ForkServerContext:
    make_socket_folder()
    # A process reads it as it starts, so it must be there before the one that all others are forked from.
    os.environ.setdefault(*ALLOCATOR)
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(list(PRELOADED))
    return context


def _listen(receiving: Connection, context: StageContext, stop: threading.Event) -> None:
    while True:
        if stop.is_set():
            raise StageInterrupted
        if not receiving.poll(POLL_SECONDS):
            continue
        kind, content = message = receiving.recv()
        if kind == "error":
            raise content
        if kind == "draft":
            context.draft.take_facts(content)
            return
        forward(message, context)


def _work(call: StageCall, context: StageContext, sending: Connection, guarded: Connection) -> None:
    work_for_parent(partial(run_body, call), context, sending, guarded, call.recipe.stage)
