"""A run ends when its Prefect server is gone: with a sentence, and in any case.

Prefect's own threads try to reach the server for minutes, some of them while the interpreter ends.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from flows.servers.addresses import HEALTH_SECONDS
from juicer.errors import JuicerError, ServiceUnavailable
from stages.runtime.connection import connect

POLL_SECONDS = 0.5
PATIENCE_SECONDS = 12.0
"""How long a server that is not ours may be away, as when it is started anew."""
GRACE_SECONDS = 12.0
"""How long the run may take to end in order."""

_OTHER_REASONS = (JuicerError, KeyboardInterrupt)
"""Have nothing to do with a server, whether it is there or not."""


class ServerWatch:
    """Looks after the server while flows run."""

    def __init__(self, is_there: Callable[[], bool], patience_s: float) -> None:
        """Begin to look.

        Args:
            is_there: Whether the server can be reached at this moment.
            patience_s: How long it may be away.
        """
        self._is_there = is_there
        self._patience_s = patience_s
        self._lost = threading.Event()
        self._in_flow = False
        self._status = 1
        threading.Thread(target=self._look, name="server watch", daemon=True).start()

    @contextmanager
    def explaining(self) -> Iterator[None]:
        """Interrupt the block if the server is lost, and say so.

        Raises:
            ServiceUnavailable: If it was lost.
        """
        self._in_flow = True
        try:
            yield
        except BaseException as error:
            self._in_flow = False
            if self._lost.is_set() or (not isinstance(error, _OTHER_REASONS) and not self._is_there()):
                self._lost.set()
                raise _loss() from None
            raise
        finally:
            self._in_flow = False

    def finish(self) -> None:
        """The command has said all it had to say; whatever ends the process now, it has succeeded."""
        self._status = 0

    def _look(self) -> None:
        seen = time.monotonic()
        while not self._lost.wait(POLL_SECONDS):
            if self._is_there():
                seen = time.monotonic()
            elif time.monotonic() - seen >= self._patience_s:
                self._lost.set()
        if self._in_flow:
            # A real signal: it also wakes whoever waits for a lock.
            signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
        time.sleep(GRACE_SECONDS)
        if self._in_flow:
            sys.stderr.write(f"juicer: {_loss()}\n")
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(self._status)


def is_reachable(url: str) -> bool:
    """Whether anybody listens at an address."""
    try:
        connect(url, HEALTH_SECONDS)
    except OSError:
        return False
    return True


def _loss() -> ServiceUnavailable:
    return ServiceUnavailable(
        "the Prefect server went away; what was made is in the store, the same command goes on from there"
    )
