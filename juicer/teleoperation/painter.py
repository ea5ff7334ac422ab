"""Draws the newest moment of a session, in a thread of its own, as long as somebody watches."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from juicer.errors import JuicerError
from juicer.imaging.jpeg import encode_jpeg
from juicer.imaging.operator_views import OperatorRenderer, OperatorView
from juicer.imaging.renderer import ViewRenderer
from juicer.teleoperation.session import Session
from juicer.teleoperation.status import Snapshot
from juicer.text import printable
from juicer.views import View

logger = logging.getLogger(__name__)

QUICK_S = 0.025
"""Where a view with shadows takes longer to be drawn, it has them only while nothing moves: what is late misleads."""
STILL = 5
"""Moments without a movement after which nothing moves."""
_PATIENCE_S = 0.5


@dataclass(frozen=True)
class Pane:
    """One of the images that an operator sees.

    Attributes:
        name: Short name.
        title: What it is called on a page.
        view: What it shows: to an operator only, or as a policy sees it, which is drawn every second time.
        width: Pixels.
        height: Pixels.
    """

    name: str
    title: str
    view: OperatorView | View
    width: int
    height: int

    @property
    def of_policy(self) -> bool:
        """Whether it is what a policy sees."""
        return isinstance(self.view, View)

    @classmethod
    def policy(cls, title: str, view: View) -> Pane:
        """What a policy sees."""
        return cls(f"policy_{view.camera}", title, view, view.width, view.height)


PANES = (
    Pane("front", "Front", OperatorView.FRONT, 480, 360),
    Pane("side", "From the right", OperatorView.SIDE, 320, 240),
    Pane("wrist", "Between the fingers", OperatorView.WRIST, 320, 240),
    Pane.policy("A policy's front view", View(camera="front")),
    Pane.policy("A policy's wrist view", View(camera="wrist")),
)
"""All images, in the order in which they are drawn and sent."""


@dataclass(frozen=True)
class Picture:
    """An image of a moment.

    Attributes:
        number: Of the moment that it shows.
        qpos: Joint positions that it shows ``(nq,)``.
        shadows: Whether it has shadows, where it may have some.
        jpeg: The image.
    """

    number: int
    qpos: NDArray[np.float64]
    shadows: bool
    jpeg: bytes


@dataclass(frozen=True)
class Frame:
    """A moment and its images.

    Attributes:
        snapshot: The moment.
        pictures: By name of the pane, the newest image of each; those of a policy may show an earlier moment.
        problem: Why there are none, as one sentence.
    """

    snapshot: Snapshot
    pictures: Mapping[str, Picture] = field(default_factory=dict)
    problem: str = ""


class Painter:
    """Draws the newest moment, and then the newest again: what was shown too late is left out."""

    def __init__(self, session: Session) -> None:
        """Prepare; :meth:`start` begins."""
        self._session = session
        self._listeners: frozenset[Callable[[], None]] = frozenset()
        self._watched = threading.Event()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="painter", daemon=True)
        self._frame = Frame(session.latest)
        self._moved_at = 0
        self._with_shadows_s = 0.0

    @property
    def frame(self) -> Frame:
        """The newest frame."""
        return self._frame

    def start(self) -> None:
        """Begin to draw."""
        self._thread.start()

    def close(self) -> None:
        """Stop, and free what drawing takes."""
        self._closing.set()
        self._watched.set()
        if self._thread.is_alive():
            self._thread.join()

    def watch(self, listener: Callable[[], None]) -> None:
        """Call a listener, from the painter's thread, whenever there is a new frame."""
        self._listeners |= {listener}
        self._watched.set()

    def leave(self, listener: Callable[[], None]) -> None:
        """Call it no more."""
        self._listeners -= {listener}
        if not self._listeners and not self._closing.is_set():
            self._watched.clear()

    def _run(self) -> None:
        try:
            self._paint()
        except JuicerError as error:
            problem = str(error)
        except Exception as error:
            logger.exception("an image cannot be drawn")
            reason = printable(" ".join(str(error).split())) or type(error).__name__
            problem = f"no more images can be drawn ({reason}); choose another task, and then go on with the episode"
        else:
            return
        # Who drives must still be told what becomes of the episode.
        for snapshot in self._snapshots():
            self._publish(Frame(snapshot, problem=problem))

    def _paint(self) -> None:
        with closing(_Brush(self._session.latest.task)) as brush:
            for snapshot in self._snapshots():
                self._show(brush, snapshot)

    def _snapshots(self) -> Iterator[Snapshot]:
        """The newest moment, and then the newest again, as long as somebody watches, until the end."""
        number = -1
        while self._watched.wait() and not self._closing.is_set():
            snapshot = self._session.newer(number, _PATIENCE_S)
            if snapshot is not None:
                number = snapshot.number
                yield snapshot

    def _show(self, brush: _Brush, snapshot: Snapshot) -> None:
        if not np.array_equal(self._frame.snapshot.qpos, snapshot.qpos):
            self._moved_at = snapshot.number
        self._publish(Frame(snapshot, {pane.name: self._picture(brush, pane, snapshot) for pane in PANES}))

    def _picture(self, brush: _Brush, pane: Pane, snapshot: Snapshot) -> Picture:
        last = self._frame.pictures.get(pane.name)
        shadows = pane.view is OperatorView.FRONT and (
            self._with_shadows_s < QUICK_S or snapshot.number >= self._moved_at + STILL
        )
        if last and (
            (np.array_equal(last.qpos, snapshot.qpos) and last.shadows >= shadows)
            or (pane.of_policy and snapshot.number < last.number + 2)
        ):
            return last
        began = time.monotonic()
        pixels = brush.draw(pane, snapshot, shadows)
        if shadows:
            self._with_shadows_s = time.monotonic() - began
        return Picture(snapshot.number, snapshot.qpos, shadows, encode_jpeg(pixels))

    def _publish(self, frame: Frame) -> None:
        self._frame = frame
        for listener in self._listeners:
            listener()


class _Brush:
    """What draws an operator's views and a policy's: apart, so that the one cannot change the other."""

    def __init__(self, task: str) -> None:
        self._operator = OperatorRenderer(task)
        self._policy = ViewRenderer(task)

    def draw(self, pane: Pane, snapshot: Snapshot, shadows: bool) -> NDArray[np.uint8]:
        if isinstance(pane.view, View):
            return self._policy.draw(snapshot.qpos, pane.view, snapshot.end_effector)
        return self._operator.draw(snapshot.qpos, pane.view, pane.width, pane.height, shadows=shadows)

    def close(self) -> None:
        self._operator.close()
        self._policy.close()
