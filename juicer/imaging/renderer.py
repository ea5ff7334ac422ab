"""Images of a scene through whatever software or hardware OpenGL the machine offers.

An OpenGL context belongs to the thread that made it. One thread therefore makes, uses and frees the only one, and draws
for all environments of the process, whatever thread they ask from.
"""

from __future__ import annotations

import os
import threading
import weakref
from concurrent.futures import Future
from dataclasses import dataclass, field
from queue import SimpleQueue
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from juicer.errors import ConfigError, RenderingUnavailable, did_you_mean
from juicer.imaging.gl import gl_context_class
from juicer.sim.arguments import is_whole, shown
from juicer.views import MAX_HEIGHT, MAX_WIDTH

Image = NDArray[np.uint8]


@dataclass(frozen=True)
class _Drawing:
    """What shall be drawn, by the canvas that belongs to ``key``."""

    key: object
    model: mujoco.MjModel
    data: mujoco.MjData
    camera: int
    width: int
    height: int
    answer: Future[Image] = field(default_factory=Future)


@dataclass(frozen=True)
class _Farewell:
    """The canvas of ``key`` is needed no more; the answer is whether it was the last and the thread ends."""

    key: object
    answer: Future[bool] = field(default_factory=Future)


class RenderWorker:
    """Draws for any number of scenes in one thread, which lives from the first image to the last scene's end."""

    def __init__(self) -> None:
        """Do nothing yet."""
        self._requests: SimpleQueue[_Drawing | _Farewell] = SimpleQueue()
        self._thread: threading.Thread | None = None
        # Held for every request but those of finalizers, so that the thread cannot end with one unanswered.
        self._lock = threading.Lock()

    def draw(self, request: _Drawing) -> Image:
        """The image, once it is drawn.

        Raises:
            RenderingUnavailable: If no OpenGL platform can draw.
        """
        with self._lock:
            if self._thread is None:
                self._thread = threading.Thread(target=self._work, name="renderer", daemon=True)
                self._thread.start()
            self._requests.put(request)
        return request.answer.result()

    def forget(self, key: object) -> None:
        """Free the canvas of a scene."""
        farewell = _Farewell(key)
        with self._lock:
            thread = self._thread
            # A forked process inherits the thread's name and nothing of it.
            if thread is None or not thread.is_alive():
                return
            self._requests.put(farewell)
        if farewell.answer.result():
            thread.join()

    def forget_later(self, key: object) -> None:
        """The same from a finalizer, which may run at any moment of any thread and must not wait."""
        self._requests.put(_Farewell(key))

    def _work(self) -> None:
        context: Any = None
        canvases: dict[object, _Canvas] = {}
        while True:
            request = self._requests.get()
            if isinstance(request, _Farewell):
                if (canvas := canvases.pop(request.key, None)) is not None:
                    canvas.free()
                if self._ends(canvases, context, request):
                    return
                continue
            try:
                context = context or _opened()
                if request.key not in canvases:
                    canvases[request.key] = _made(request.model)
                request.answer.set_result(canvases[request.key].draw(request))
            except BaseException as error:
                request.answer.set_exception(error)
            # Waiting for the next one must not keep an environment's data alive.
            del request

    def _ends(self, canvases: dict[object, _Canvas], context: Any, farewell: _Farewell) -> bool:
        with self._lock:
            is_last = not canvases and self._requests.empty()
            if is_last:
                if context is not None:
                    context.free()
                self._thread = None
        farewell.answer.set_result(is_last)
        return is_last


_WORKER = RenderWorker()


class CameraRenderer:
    """Draws named cameras of one model; what that takes is made when the first image is asked for."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Remember the model."""
        self._model = model
        self._key = object()
        # Whoever forgets to close leaves nothing behind. At the end of the process the system frees everything.
        weakref.finalize(self, _WORKER.forget_later, self._key).atexit = False

    def draw(self, data: mujoco.MjData, camera: str, width: int, height: int) -> Image:
        """Image ``(height, width, 3)``, without shadows and reflections (they cost seven times the rest).

        Raises:
            ConfigError: If there is no such camera, or no such size.
            RenderingUnavailable: If no OpenGL platform can draw.
        """
        cameras = [self._model.camera(index).name for index in range(self._model.ncam)]
        if camera not in cameras:
            raise ConfigError(f"unknown camera {shown(camera)}{did_you_mean(str(camera), cameras)}")
        if not _is_size(width, MAX_WIDTH) or not _is_size(height, MAX_HEIGHT):
            largest = f"{MAX_WIDTH}x{MAX_HEIGHT}"
            raise ConfigError(f"an image measures 1x1 to {largest} pixels, got {shown(width)}x{shown(height)}")
        _Process.check()
        return _WORKER.draw(_Drawing(self._key, self._model, data, cameras.index(camera), int(width), int(height)))

    def close(self) -> None:
        """Free what was made; a later image makes it again."""
        _WORKER.forget(self._key)


class _Process:
    """The process that draws. Of OpenGL's state a forked process inherits all but the threads that work on it."""

    _drawing: int | None = None

    @classmethod
    def check(cls) -> None:
        if cls._drawing not in (None, os.getpid()):
            raise RenderingUnavailable(
                "this process was forked from one that had drawn images, which OpenGL does not survive; "
                "start it with multiprocessing's 'spawn' or 'forkserver', or draw nothing before it is forked"
            )
        cls._drawing = os.getpid()


class _Canvas:
    """A model's geometry in the OpenGL context of the thread that makes it."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_150)
        self._scene = mujoco.MjvScene(model, maxgeom=10_000)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
        self._scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = 0
        self._options = mujoco.MjvOption()
        self._camera = mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED

    def draw(self, request: _Drawing) -> Image:
        self._camera.fixedcamid = request.camera
        everything = mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(request.model, request.data, self._options, None, self._camera, everything, self._scene)
        # Every model has a buffer of its own in the one context.
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        viewport = mujoco.MjrRect(0, 0, request.width, request.height)
        mujoco.mjr_render(viewport, self._scene, self._context)
        image = np.empty((request.height, request.width, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(image, None, viewport, self._context)
        # OpenGL's first row is the lowest.
        return np.ascontiguousarray(image[::-1])

    def free(self) -> None:
        self._context.free()


def _opened() -> Any:
    """An OpenGL context, current in this thread."""
    try:
        context = gl_context_class()(MAX_WIDTH, MAX_HEIGHT)
        context.make_current()
    except Exception as error:
        raise _unavailable(error) from None
    return context


def _made(model: mujoco.MjModel) -> _Canvas:
    try:
        return _Canvas(model)
    except Exception as error:
        raise _unavailable(error) from None


def _unavailable(error: Exception) -> RenderingUnavailable:
    """Every OpenGL platform fails in its own way."""
    return RenderingUnavailable(
        f"no OpenGL platform can draw an image here ({type(error).__name__}: {error}); "
        "set MUJOCO_GL=egl with libegl1 and libgl1-mesa-dri installed, or MUJOCO_GL=osmesa with libosmesa6"
    )


def _is_size(value: object, largest: int) -> bool:
    return is_whole(value) and 0 < int(value) <= largest
