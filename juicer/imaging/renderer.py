"""Images of a scene through whatever software or hardware OpenGL the machine offers.

An OpenGL context belongs to the thread that made it. Every renderer therefore has one thread in which its context is
made, used and freed, so that any other thread may ask for images.
"""

from __future__ import annotations

import os
import threading
import weakref
from concurrent.futures import Future
from dataclasses import dataclass, field
from queue import SimpleQueue

import mujoco
import numpy as np
from numpy.typing import NDArray

from juicer.errors import ConfigError, RenderingUnavailable, did_you_mean
from juicer.imaging.gl import gl_context_class
from juicer.sim.arguments import is_whole, shown

MAX_WIDTH, MAX_HEIGHT = 1280, 720

Image = NDArray[np.uint8]


@dataclass(frozen=True)
class _Request:
    data: mujoco.MjData
    camera: int
    width: int
    height: int
    answer: Future[Image] = field(default_factory=Future)


class CameraRenderer:
    """Draws named cameras of one model; thread and context are made when the first image is asked for."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Remember the model."""
        self._model = model
        self._requests: SimpleQueue[_Request | None] = SimpleQueue()
        self._thread: threading.Thread | None = None
        self._lock = threading.Lock()
        # Whoever forgets to close leaves no thread behind. At the end of the process the system frees everything.
        weakref.finalize(self, self._requests.put, None).atexit = False

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
        request = _Request(data, cameras.index(camera), int(width), int(height))
        with self._lock:
            if self._thread is None:
                self._thread = threading.Thread(
                    target=_draw_until_closed, args=(self._model, self._requests), name="renderer", daemon=True
                )
                self._thread.start()
            self._requests.put(request)
            return request.answer.result()

    def close(self) -> None:
        """Free the context and end the thread."""
        with self._lock:
            if self._thread is not None:
                self._requests.put(None)
                self._thread.join()
                self._thread = None


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
    """An OpenGL context with a model's geometry in it; belongs to the thread that makes it."""

    _making = threading.Lock()

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        with self._making:
            self._gl = gl_context_class()(MAX_WIDTH, MAX_HEIGHT)
            self._gl.make_current()
            self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_150)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        self._scene = mujoco.MjvScene(model, maxgeom=10_000)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
        self._scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = 0
        self._options = mujoco.MjvOption()
        self._camera = mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED

    def draw(self, data: mujoco.MjData, camera: int, width: int, height: int) -> Image:
        self._camera.fixedcamid = camera
        everything = mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(self._model, data, self._options, None, self._camera, everything, self._scene)
        viewport = mujoco.MjrRect(0, 0, width, height)
        mujoco.mjr_render(viewport, self._scene, self._context)
        image = np.empty((height, width, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(image, None, viewport, self._context)
        # OpenGL's first row is the lowest.
        return np.ascontiguousarray(image[::-1])

    def free(self) -> None:
        self._context.free()
        self._gl.free()


def _draw_until_closed(model: mujoco.MjModel, requests: SimpleQueue[_Request | None]) -> None:
    canvas: _Canvas | None = None
    while (request := requests.get()) is not None:
        try:
            canvas = canvas or _made(model)
            image = canvas.draw(request.data, request.camera, request.width, request.height)
            request.answer.set_result(image)
        except BaseException as error:
            request.answer.set_exception(error)
        # Waiting for the next one must not keep an environment's data alive.
        del request
    if canvas is not None:
        canvas.free()


def _made(model: mujoco.MjModel) -> _Canvas:
    try:
        return _Canvas(model)
    except Exception as error:  # every OpenGL platform fails in its own way
        raise RenderingUnavailable(
            f"no OpenGL platform can draw an image here ({type(error).__name__}: {error}); "
            "set MUJOCO_GL=egl with libegl1 and libgl1-mesa-dri installed, or MUJOCO_GL=osmesa with libosmesa6"
        ) from None


def _is_size(value: object, largest: int) -> bool:
    return is_whole(value) and 0 < int(value) <= largest
