"""Work for many environments of one task, a thread each (MuJoCo steps without the interpreter lock)."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from queue import SimpleQueue
from types import TracebackType
from typing import Self, TypeVar

from juicer.sim.env import AssemblyEnv

ItemT = TypeVar("ItemT")
ResultT = TypeVar("ResultT")


class EnvironmentPool:
    """Environments that do one piece of work at a time each; to be used in a ``with`` statement.

    Which environment does a piece of work is left to chance, so the work must begin by setting its state.
    """

    def __init__(self, task: str, num_workers: int | None = None, max_steps: int | None = None) -> None:
        """Create ``num_workers`` environments, one a processor if None."""
        num_workers = num_workers or os.cpu_count() or 1
        self._envs = [AssemblyEnv(task, max_steps=max_steps) for _ in range(num_workers)]
        self._idle: SimpleQueue[AssemblyEnv] = SimpleQueue()
        for env in self._envs:
            self._idle.put(env)
        self._threads = ThreadPoolExecutor(num_workers)

    def __enter__(self) -> Self:
        """Hand out the pool."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Drop work that has not begun, wait for the rest, and close the environments."""
        self._threads.shutdown(cancel_futures=True)
        for env in self._envs:
            env.close()

    def map(self, work: Callable[[AssemblyEnv, ItemT], ResultT], items: Iterable[ItemT]) -> Iterator[ResultT]:
        """Results of ``work(env, item)`` in the order of the items."""

        def work_with_idle(item: ItemT) -> ResultT:
            env = self._idle.get()
            try:
                return work(env, item)
            finally:
                self._idle.put(env)

        return self._threads.map(work_with_idle, items)
