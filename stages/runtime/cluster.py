"""A stage call as data, for a worker of a cluster: a process that shares the artifact store and nothing else."""

from __future__ import annotations

import importlib
import threading
from collections.abc import Callable
from dataclasses import replace

from stages.runtime.context import Display
from stages.runtime.execution import Finished, execute, is_forced
from stages.runtime.isolation import PRELOADED
from stages.runtime.messages import portable
from stages.runtime.session import Session
from stages.runtime.stage import StageCall

Opener = Callable[[str], Session]
"""Gives, on a worker, what stages share there, for the address of a store. It travels by its name."""

_ONE_AT_A_TIME = threading.Lock()
"""A worker is the process of its stage, as stages would share torch's switches; one of several threads waits."""


class Order:
    """What travels to a worker. Not a dataclass, so that neither Prefect nor Dask searches it."""

    def __init__(self, call: StageCall, session: Session, opener: Opener) -> None:
        """Take from a session all that the call needs elsewhere.

        Args:
            call: The stage with its arguments and its recipe.
            session: Whose store, label and wish to make it anew go along.
            opener: Opens the store there.
        """
        self.call = call
        self.store = session.store.url
        self.label = session.label
        self.is_forced = is_forced(call, session)
        self.opener = opener

    def execute(self, display: Display, stop: threading.Event) -> Finished:
        """Make the artifact on this worker, unless it is in the store.

        Raises:
            StageInterrupted: If ``stop`` was set; it takes effect at the next report.
            ForeignCode: If this worker has other code than the recipe names.
            Exception: Whatever the body raised, fit to be sent back.
        """
        name = self.call.recipe.stage
        with _ONE_AT_A_TIME:
            # All before the first stage: source that is edited later is then not taken for what runs.
            for module in PRELOADED:
                importlib.import_module(module)
            session = replace(
                self.opener(self.store),
                display=display,
                stop=stop,
                label=self.label,
                forced=frozenset({name} if self.is_forced else ()),
            )
            try:
                return execute(self.call, session)
            except Exception as error:
                failure = portable(error, name)
        # Raised out here, it carries along nothing: clusters pickle the context of an error, too.
        raise failure
