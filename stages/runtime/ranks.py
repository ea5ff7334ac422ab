"""Run a stage's body in several processes at once, started and watched by torch's own launcher, that of ``torchrun``.

The body runs in each of them, on a device of its own; they share its work through ``torch.distributed``. They find each
other through a file and speak over the loopback interface: nothing listens for other machines.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import resource
import signal
import tempfile
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from functools import partial
from multiprocessing.connection import Connection, wait
from pathlib import Path

from juicer.artifacts.draft import Draft
from juicer.errors import JuicerError, StageDied
from stages.runtime.context import StageContext
from stages.runtime.messages import Message, describe_end, forward, without_listeners, work_for_parent
from stages.runtime.stage import StageCall, check_code

POLL_SECONDS = 0.2
SHUTDOWN_SECONDS = 5
STARTED = "started"
_LAUNCHERS = ("torch.distributed.elastic", "torch.multiprocessing")
LOOPBACK = {"GLOO_SOCKET_IFNAME": "lo", "NCCL_SOCKET_IFNAME": "lo"}
"""The interface that torch's two ways to communicate use."""


def run_body(call: StageCall, context: StageContext) -> None:
    """Run the body of a stage, in this process or in as many as the machine has for it; the draft has its facts then.

    Its CPU time is that of this process while the body ran, and of the processes that have ended by then: of the stage
    alone, where it has the process to itself.

    Raises:
        ForeignCode: If there is other code here than the recipe names.
        StageDied: If one of several processes ended without a message.
        Exception: Whatever the body raised.
    """
    check_code(call)
    before = _cpu_seconds()
    if call.stage.facts.needs == "devices" and context.machine.processes > 1:
        context.draft.take_facts(_run_ranks(call, context))
    else:
        call.stage.body(context, **call.arguments)
    context.draft.cpu_seconds = _cpu_seconds() - before


def _cpu_seconds() -> float:
    """CPU time of this process and of those it started that have ended, their own children included."""
    # Not os.times(), which rounds each part down to a hundredth of a second.
    used = (resource.getrusage(whose) for whose in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(each.ru_utime + each.ru_stime for each in used)


def _run_ranks(call: StageCall, context: StageContext) -> Draft:
    spawning = multiprocessing.get_context("spawn")
    pipes = [spawning.Pipe(duplex=False) for _ in range(context.machine.processes)]
    receiving, sending = [pipe[0] for pipe in pipes], [pipe[1] for pipe in pipes]
    guarded, guard = spawning.Pipe(duplex=False)
    with tempfile.TemporaryDirectory(prefix="juicer-ranks-") as folder, ThreadPoolExecutor(1) as pool:
        # The launcher waits in a thread of its own: progress is heard, and may interrupt, in this one.
        launched = pool.submit(_launch, call, without_listeners(context), sending, guarded, Path(folder))
        try:
            return _listen(_Results(context, call.recipe.stage), launched, receiving, sending)
        finally:
            # Whatever is still at work ends now.
            for end in (guard, guarded, *sending):
                end.close()


def _launch(
    call: StageCall, context: StageContext, sending: Sequence[Connection], guarded: Connection, folder: Path
) -> int | None:
    """Start the processes and wait for them; returns the exit status of one that failed."""
    from torch.distributed.elastic.multiprocessing import DefaultLogsSpecs  # torch takes seconds to import
    from torch.distributed.elastic.multiprocessing.errors import ChildFailedError
    from torch.distributed.launcher.api import LaunchConfig, elastic_launch

    # What went wrong is told by the processes themselves, in a sentence.
    for name in _LAUNCHERS:
        logging.getLogger(name).addHandler(logging.NullHandler())
        logging.getLogger(name).propagate = False
    # Else it opens a port to all machines for the processes to meet at.
    os.environ["TORCH_DISABLE_SHARE_RDZV_TCP_STORE"] = "1"
    config = LaunchConfig(
        min_nodes=1,
        max_nodes=1,
        nproc_per_node=len(sending),
        run_id=context.draft.ref.id,
        rdzv_backend="c10d",
        rdzv_endpoint=str(folder / "launcher"),
        rdzv_configs={"store_type": "file"},
        local_addr="127.0.0.1",
        max_restarts=0,
        logs_specs=DefaultLogsSpecs(log_dir=str(folder)),
        shutdown_timeout=SHUTDOWN_SECONDS,
    )
    try:
        elastic_launch(config, _rank)(call, context, sending, guarded, folder / "processes")
    except ChildFailedError as error:
        return error.get_first_failure()[1].exitcode
    return None


def _listen(
    results: _Results, launched: Future[int | None], receiving: Sequence[Connection], sending: Sequence[Connection]
) -> Draft:
    """Listen to the processes until all have ended; returns the draft as the first of them has left it."""
    numbers = {end: number for number, end in enumerate(receiving)}
    while numbers:
        if launched.done() or results.num_started == len(receiving):
            # Every process has its own by now; without ours, what one was saying when it was killed comes to an end.
            for end in sending:
                end.close()
        messages = [(end, _receive(end)) for end in wait(list(numbers), POLL_SECONDS) if isinstance(end, Connection)]
        # One that ended without a word is why others fail in the same moment.
        for end, message in sorted(messages, key=lambda pair: pair[1] is not None):
            results.take(numbers[end], message)
            if message is None:
                del numbers[end]
    return results.draft(launched.result())


def _receive(end: Connection) -> Message | None:
    """What a process says next; None if it has ended."""
    with suppress(EOFError):
        message: Message = end.recv()
        return message
    return None


class _Results:
    """What has been heard of the processes of a stage; the first one speaks for all of them.

    Attributes:
        num_started: How many are at work, or were.
    """

    def __init__(self, context: StageContext, name: str) -> None:
        self.num_started = 0
        self._context = context
        self._name = name
        self._drafts: dict[int, Draft] = {}
        self._failures: list[Exception | None] = []

    def take(self, number: int, message: Message | None) -> None:
        """Take down what a process said, or that it has ended."""
        kind, content = ("end", None) if message is None else message
        if kind == STARTED:
            self.num_started += 1
        elif isinstance(content, Draft):
            self._drafts[number] = content
        elif kind == "error" or (message is None and number not in self._drafts):
            self._failures.append(content)
        elif message and number == 0:
            forward(message, self._context)

    def draft(self, status: int | None) -> Draft:
        """The draft with its facts, if all went well.

        Args:
            status: Exit status of a process that failed.
        """
        if not self._failures:
            return self._drafts[0]
        # What a user can mend, or else what came first, of which the others may be consequences.
        cause = next((each for each in self._failures if isinstance(each, JuicerError)), self._failures[0])
        was_killed = status is not None and status < 0 and status != -signal.SIGTERM
        if cause is None or (was_killed and not isinstance(cause, JuicerError)):
            # Another status is that of a process that missed the one which was killed.
            shown = status if was_killed else None
            raise StageDied(describe_end(f"one of the processes of stage '{self._name}'", shown))
        raise cause


def _rank(
    call: StageCall, context: StageContext, sending: Sequence[Connection], guarded: Connection, meeting: Path
) -> None:
    """Work as one of the processes; the launcher says which in the environment."""
    number, machine = int(os.environ["RANK"]), context.machine
    for other, end in enumerate(sending):
        if other != number:
            end.close()
    sending[number].send((STARTED, None))
    own = replace(context, machine=replace(machine, devices=(machine.devices[number % len(machine.devices)],)))
    if not work_for_parent(
        partial(_take_part, call, number, meeting), own, sending[number], guarded, call.recipe.stage
    ):
        # At once: what runs at a normal exit might wait for another process.
        os._exit(1)


def _take_part(call: StageCall, number: int, meeting: Path, context: StageContext) -> None:
    # One that waits for others within torch would not notice a signal that Python handles.
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    check_code(call)
    from juicer.training.ranks import Ranks, joined  # torch takes seconds to import

    os.environ |= LOOPBACK
    with joined(Ranks(number, context.machine.processes), context.machine.device, meeting):
        call.stage.body(context, **call.arguments)
