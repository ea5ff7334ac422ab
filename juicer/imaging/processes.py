"""Processes that draw: software OpenGL keeps one processor busy, and a context belongs to the thread that made it."""

from __future__ import annotations

import multiprocessing
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import cycle
from multiprocessing.connection import Connection
from types import TracebackType
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from juicer.errors import RenderingUnavailable
from juicer.imaging.gl import gl_name
from juicer.imaging.renderer import ViewRenderer
from juicer.views import View

AHEAD = 2
"""Batches that wait for a process, or that it has drawn and nobody has taken."""
SECONDS_TO_END = 5.0

Images = NDArray[np.uint8]
ImagesOfViews = Mapping[str, Images]
"""By a view's name."""


class Scenes(NamedTuple):
    """What is drawn.

    Attributes:
        positions: Positions of all joints ``(N, nq)``.
        end_effector: Its position as it was observed ``(N, 3)``, robot base frame [m].
    """

    positions: NDArray[np.float64]
    end_effector: NDArray[np.float32]


class DrawingProcesses:
    """Processes that draw views of one task's scenes, each with an OpenGL context of its own.

    They end when they are closed, or with the process that started them, whatever ends that. A process that may start
    none, as a worker of a cluster is, draws itself.

    Attributes:
        drawn_by: What draws, in the words of OpenGL platforms, each once.
    """

    def __init__(self, task: str, views: Sequence[View], workers: int) -> None:
        """Start them.

        Raises:
            RenderingUnavailable: If no OpenGL platform can draw.
        """
        spawning = multiprocessing.get_context("spawn")
        self._links: list[Connection] = []
        self._processes = []
        self._views = views
        self._own: ViewRenderer | None = None
        self.drawn_by: list[str]
        if multiprocessing.current_process().daemon:
            self._own, self.drawn_by = ViewRenderer(task), [gl_name()]
            return
        try:
            for _ in range(workers):
                link, their_end = spawning.Pipe()
                self._links.append(link)
                process = spawning.Process(target=_work, args=(their_end, task, views), name="drawing", daemon=True)
                process.start()
                their_end.close()
                self._processes.append(process)
            self.drawn_by = sorted({_received(link) for link in self._links})
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        """Hand them out."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """End them."""
        self.close()

    @property
    def pids(self) -> tuple[int, ...]:
        """Their numbers in the system."""
        return tuple(process.pid or 0 for process in self._processes)

    def close(self) -> None:
        """End them; what they are at is lost."""
        if self._own is not None:
            self._own.close()
        for link in self._links:
            link.close()
        for process in self._processes:
            process.join(SECONDS_TO_END)
            process.terminate()
            process.join()

    def draw(self, batches: Iterable[Scenes]) -> Iterator[ImagesOfViews]:
        """Images ``(N, height, width, 3)`` of every view of each batch, in order.

        Raises:
            JuicerError: Whatever drawing raises.
        """
        if self._own is not None:
            yield from (_drawn(self._own, self._views, scenes) for scenes in batches)
            return
        ahead: deque[Connection] = deque()
        for link, scenes in zip(cycle(self._links), batches, strict=False):
            if len(ahead) == AHEAD * len(self._links):
                yield _received(ahead.popleft())
            _send(link, scenes)
            ahead.append(link)
        while ahead:
            yield _received(ahead.popleft())


def _send(link: Connection, scenes: Scenes) -> None:
    try:
        link.send(scenes)
    except OSError:
        # It has ended, and behind what it had drawn it may have said why.
        while True:
            _received(link)


def _received(link: Connection) -> Any:
    try:
        answer = link.recv()
    except (EOFError, OSError):
        raise _ended() from None
    if isinstance(answer, Exception):
        raise answer
    return answer


def _ended() -> RenderingUnavailable:
    return RenderingUnavailable(
        "a process that draws images ended before its work was done: the machine may have run out of memory, or a "
        "script that draws lacks 'if __name__ == \"__main__\":' around what it does, which such processes need"
    )


def _drawn(renderer: ViewRenderer, views: Sequence[View], scenes: Scenes) -> ImagesOfViews:
    return {
        view.name: np.stack([renderer.draw(positions, view, at) for positions, at in zip(*scenes, strict=True)])
        for view in views
    }


def _work(link: Connection, task: str, views: Sequence[View]) -> None:
    try:
        renderer = ViewRenderer(task)
        link.send(gl_name())
        while True:
            link.send(_drawn(renderer, views, link.recv()))
    except (EOFError, BrokenPipeError, KeyboardInterrupt):
        return
    except Exception as error:
        link.send(error)
