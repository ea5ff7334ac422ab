"""Draws the newest moment of a session, in a thread of its own, as long as somebody watches."""

from __future__ import annotations

import io
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from juicer.errors import JuicerError
from juicer.imaging.renderer import ViewRenderer
from juicer.teleoperation.session import Session
from juicer.teleoperation.status import Snapshot
from juicer.views import FRONT_CAMERA, View

QUICK_S = 0.02
"""An image that takes longer is drawn well only while nothing moves."""
STILL = 5
"""Moments without a movement after which nothing moves."""
_QUALITY = 85
_PATIENCE_S = 0.5

Pixels = NDArray[np.uint8]
Draw = Callable[[ViewRenderer, Snapshot], Pixels]


@dataclass(frozen=True)
class Pane:
    """One of the images that an operator sees.

    Attributes:
        name: Short name.
        title: What it is called on a page.
        width: Pixels.
        height: Pixels.
        draw: Draws it.
        quickly: Draws it less well, where drawing it well would take too long to drive by.
        of_policy: Whether it is what a policy sees; such images are drawn every second time.
    """

    name: str
    title: str
    width: int
    height: int
    draw: Draw
    quickly: Draw | None = None
    of_policy: bool = False


def _for_people(camera: str, width: int, height: int) -> Draw:
    return lambda renderer, snapshot: renderer.draw_for_people(snapshot.qpos, camera, width, height)


def _plain(view: View) -> Draw:
    return lambda renderer, snapshot: renderer.draw(snapshot.qpos, view, snapshot.end_effector)


_FRONT = View(camera="front", width=480, height=360, supersampling=2)
_WRIST = View(camera="wrist", width=480, height=270)
_POLICY_FRONT, _POLICY_WRIST = View(camera="front"), View(camera="wrist")

PANES = (
    Pane("operator", "Your view", 480, 360, _for_people(FRONT_CAMERA, 480, 360), quickly=_plain(_FRONT)),
    Pane("wrist", "Wrist", 480, 270, _plain(_WRIST)),
    Pane("policy_front", "Policy: front", 96, 96, _plain(_POLICY_FRONT), of_policy=True),
    Pane("policy_wrist", "Policy: wrist", 96, 96, _plain(_POLICY_WRIST), of_policy=True),
)
"""All images, in the order in which they are drawn and sent; shadows, which cost most, in the first only."""


@dataclass(frozen=True)
class Picture:
    """An image of a moment.

    Attributes:
        number: Of the moment that it shows.
        qpos: Joint positions that it shows ``(nq,)``.
        jpeg: The image.
        is_quick: Whether it could be drawn better.
    """

    number: int
    qpos: NDArray[np.float64]
    jpeg: bytes
    is_quick: bool = False


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
        self._renderer = ViewRenderer(session.latest.task)
        self._listeners: set[Callable[[], None]] = set()
        self._watched = threading.Event()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="painter", daemon=True)
        self._frame = Frame(session.latest)
        self._moved_at = 0
        self._well_s = 0.0

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
        self._renderer.close()

    def watch(self, listener: Callable[[], None]) -> None:
        """Call a listener, from the painter's thread, whenever there is a new frame."""
        self._listeners = self._listeners | {listener}
        self._watched.set()

    def leave(self, listener: Callable[[], None]) -> None:
        """Call it no more."""
        self._listeners = self._listeners - {listener}
        if not self._listeners:
            self._watched.clear()

    def _run(self) -> None:
        number = -1
        while not self._closing.is_set():
            self._watched.wait()
            snapshot = self._session.newer(number, _PATIENCE_S)
            if snapshot is None:
                continue
            number = snapshot.number
            try:
                self._frame = Frame(snapshot, self._pictures(snapshot))
            except JuicerError as error:
                self._frame = Frame(snapshot, problem=str(error))
            for listener in self._listeners:
                listener()

    def _pictures(self, snapshot: Snapshot) -> Mapping[str, Picture]:
        if not np.array_equal(self._frame.snapshot.qpos, snapshot.qpos):
            self._moved_at = snapshot.number
        return {pane.name: self._picture(pane, snapshot) for pane in PANES}

    def _picture(self, pane: Pane, snapshot: Snapshot) -> Picture:
        last = self._frame.pictures.get(pane.name)
        quickly = pane.quickly is not None and self._well_s > QUICK_S and snapshot.number < self._moved_at + STILL
        if last and (
            (np.array_equal(last.qpos, snapshot.qpos) and (quickly or not last.is_quick))
            or (pane.of_policy and snapshot.number < last.number + 2)
        ):
            return last
        if quickly and pane.quickly:
            return Picture(snapshot.number, snapshot.qpos, _encoded(pane.quickly(self._renderer, snapshot)), True)
        began = time.monotonic()
        pixels = pane.draw(self._renderer, snapshot)
        if pane.quickly:
            self._well_s = time.monotonic() - began
        return Picture(snapshot.number, snapshot.qpos, _encoded(pixels))


def _encoded(pixels: Pixels) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "JPEG", quality=_QUALITY)
    return buffer.getvalue()
