"""Images of a scene through whatever software or hardware OpenGL the machine offers.

An OpenGL context belongs to the thread that made it. One thread therefore makes, uses and frees the only one, and draws
for all environments of the process, whatever thread they ask from. It draws a visual model of its own, placed by the
joint positions that come with a request, so what is drawn depends on these alone.
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
from juicer.imaging.appearance import alter
from juicer.imaging.cameras import Frustum
from juicer.imaging.gl import current_context, unavailable
from juicer.imaging.look import Look
from juicer.imaging.panda_mesh import has_panda_mesh
from juicer.imaging.visual_model import visual_model
from juicer.shifts import ShiftOfEpisode
from juicer.sim.arguments import is_whole, shown
from juicer.views import CAMERAS, MAX_HEIGHT, MAX_WIDTH, View

Image = NDArray[np.uint8]
Positions = NDArray[np.float64]


@dataclass(frozen=True)
class _Drawing:
    """What shall be drawn, for whom; width and height are those of the image, each pixel a square of samples."""

    owner: object
    task_name: str
    look: Look
    qpos: Positions
    camera: str
    frustum: Frustum
    width: int
    height: int
    supersampling: int = 1
    shift: ShiftOfEpisode | None = None
    answer: Future[Image] = field(default_factory=Future)


@dataclass(frozen=True)
class _Release:
    """An owner needs nothing more; the answer is whether it was the last and the thread ends."""

    owner: object
    answer: Future[bool] = field(default_factory=Future)


class RenderWorker:
    """Draws for any number of owners in one thread, which lives from the first image to the last owner's end."""

    def __init__(self) -> None:
        """Do nothing yet."""
        self._requests: SimpleQueue[_Drawing | _Release] = SimpleQueue()
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

    def release(self, owner: object) -> None:
        """Free what was made for an owner, as far as no other needs it."""
        release = _Release(owner)
        with self._lock:
            thread = self._thread
            # A forked process inherits the thread's name and nothing of it.
            if thread is None or not thread.is_alive():
                return
            self._requests.put(release)
        if release.answer.result():
            thread.join()

    def release_without_waiting(self, owner: object) -> None:
        """The same from a finalizer, which may run at any moment of any thread and must not wait."""
        self._requests.put(_Release(owner))

    def _work(self) -> None:
        canvases = _Canvases()
        while True:
            request = self._requests.get()
            if isinstance(request, _Release):
                canvases.release(request.owner)
                if self._ends(canvases, request):
                    return
                continue
            try:
                request.answer.set_result(canvases.draw(request))
            except BaseException as error:
                request.answer.set_exception(error)

    def _ends(self, canvases: _Canvases, release: _Release) -> bool:
        with self._lock:
            is_last = canvases.is_empty and self._requests.empty()
            if is_last:
                canvases.free()
                self._thread = None
        release.answer.set_result(is_last)
        return is_last


_WORKER = RenderWorker()


def look_for_people() -> Look:
    """The best look that can be drawn here."""
    return Look("mesh" if has_panda_mesh() else "primitives", for_people=True)


class ViewRenderer:
    """Draws a task's scene from joint positions; what that takes is made when the first image is asked for."""

    def __init__(self, task_name: str) -> None:
        """Remember the task."""
        self._task_name = task_name
        self._owner = object()
        # Whoever forgets to close leaves nothing behind. At the end of the process the system frees everything.
        weakref.finalize(self, _WORKER.release_without_waiting, self._owner).atexit = False

    def draw(
        self, qpos: Positions, view: View, end_effector: NDArray[np.float32], shift: ShiftOfEpisode | None = None
    ) -> Image:
        """The image ``(height, width, 3)`` of a view: plain, without smooth edges and shadows, and quickly drawn.

        Args:
            qpos: The simulator's joint positions ``(nq,)``.
            view: What is shown.
            end_effector: Position ``(3,)`` in the robot base frame, as in proprioception; a gaze crop is placed by it.
            shift: By what an episode's light and cameras are changed; a gaze crop is placed as if they were not.

        Raises:
            ConfigError: If there is no such task, or the robot's mesh is asked for and not installed.
            InvalidEpisode: If a gaze crop is to be placed by a position that is not finite.
            RenderingUnavailable: If no OpenGL platform can draw.
        """
        frustum = Frustum.of_view(view, end_effector)
        look = Look(view.robot)
        return self._draw(look, qpos, view.camera, frustum, view.width, view.height, view.supersampling, shift)

    def draw_for_people(self, qpos: Positions, camera: str, width: int, height: int) -> Image:
        """Undistorted image ``(height, width, 3)`` of a camera, as well as can be drawn here.

        Args:
            qpos: The simulator's joint positions ``(nq,)``.
            camera: ``front`` or ``wrist``.
            width: Pixels.
            height: Pixels.

        Raises:
            ConfigError: If there is no such camera, or no such size.
            RenderingUnavailable: If no OpenGL platform can draw.
        """
        if camera not in CAMERAS:
            raise ConfigError(f"unknown camera {shown(camera)}{did_you_mean(str(camera), CAMERAS)}")
        if not _is_size(width, MAX_WIDTH) or not _is_size(height, MAX_HEIGHT):
            largest = f"{MAX_WIDTH}x{MAX_HEIGHT}"
            raise ConfigError(f"an image measures 1x1 to {largest} pixels, got {shown(width)}x{shown(height)}")
        width, height = int(width), int(height)
        return self._draw(look_for_people(), qpos, camera, Frustum.of_image(width, height), width, height)

    def _draw(
        self,
        look: Look,
        qpos: Positions,
        camera: str,
        frustum: Frustum,
        width: int,
        height: int,
        samples: int = 1,
        shift: ShiftOfEpisode | None = None,
    ) -> Image:
        _Process.check()
        # A copy: whoever asks may change the state before it is drawn by another thread.
        qpos = np.array(qpos, np.float64)
        asked = _Drawing(self._owner, self._task_name, look, qpos, camera, frustum, width, height, samples, shift)
        return _WORKER.draw(asked)

    def close(self) -> None:
        """Free what was made; a later image makes it again."""
        _WORKER.release(self._owner)


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


class _Canvases:
    """The OpenGL context of the thread that makes it, and a canvas a scene and look, whoever it is drawn for."""

    def __init__(self) -> None:
        self._context: Any = None
        self._canvases: dict[tuple[str, Look], _Canvas] = {}
        self._owners: dict[tuple[str, Look], set[object]] = {}

    @property
    def is_empty(self) -> bool:
        return not self._canvases

    def draw(self, drawing: _Drawing) -> Image:
        self._context = self._context or current_context(MAX_WIDTH, MAX_HEIGHT)
        key = (drawing.task_name, drawing.look)
        if key not in self._canvases:
            self._canvases[key] = _made(*key)
        self._owners.setdefault(key, set()).add(drawing.owner)
        return self._canvases[key].draw(drawing)

    def release(self, owner: object) -> None:
        for key, owners in list(self._owners.items()):
            owners.discard(owner)
            if not owners:
                self._canvases.pop(key).free()
                del self._owners[key]

    def free(self) -> None:
        if self._context is not None:
            self._context.free()


class _Canvas:
    """A visual model's geometry in the OpenGL context of the thread that makes it."""

    def __init__(self, model: mujoco.MjModel, look: Look) -> None:
        self._model = model
        self._data = mujoco.MjData(model)
        self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_50)
        self._scene = mujoco.MjvScene(model, maxgeom=model.ngeom + model.nsite)
        for effect in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
            self._scene.flags[effect] = look.for_people
        self._options = mujoco.MjvOption()
        self._camera_ids = {name: model.camera(name).id for name in CAMERAS}
        self._camera = mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED

    def draw(self, drawing: _Drawing) -> Image:
        model, data, scene = self._model, self._data, self._scene
        data.qpos[:] = drawing.qpos
        mujoco.mj_kinematics(model, data)
        mujoco.mj_camlight(model, data)
        self._camera.fixedcamid = self._camera_ids[drawing.camera]
        everything = mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(model, data, self._options, None, self._camera, everything, scene)
        self._aim(drawing.frustum)
        if drawing.shift:
            alter(scene, drawing.shift, drawing.camera)
        # Every canvas has a buffer of its own in the one context.
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        width, height = drawing.width * drawing.supersampling, drawing.height * drawing.supersampling
        self._provide(width, height)
        viewport = mujoco.MjrRect(0, 0, width, height)
        mujoco.mjr_render(viewport, scene, self._context)
        image = np.empty((height, width, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(image, None, viewport, self._context)
        # OpenGL's first row is the lowest.
        return _mean(image[::-1], drawing.supersampling)

    def _provide(self, width: int, height: int) -> None:
        """Make the buffer as large as it must be."""
        context = self._context
        if width > context.offWidth or height > context.offHeight:
            mujoco.mjr_resizeOffscreen(max(width, context.offWidth), max(height, context.offHeight), context)

    def _aim(self, frustum: Frustum) -> None:
        for eye in self._scene.camera:
            near = eye.frustum_near
            eye.frustum_center = near * (frustum.left + frustum.right) / 2
            eye.frustum_width = near * (frustum.right - frustum.left) / 2
            eye.frustum_bottom, eye.frustum_top = near * frustum.bottom, near * frustum.top

    def free(self) -> None:
        self._context.free()


def _mean(image: Image, supersampling: int) -> Image:
    """The mean of every square of pixels, in an array of its own."""
    if supersampling == 1:
        return np.ascontiguousarray(image)
    height, width, _ = image.shape
    squares = image.reshape(height // supersampling, supersampling, width // supersampling, supersampling, 3)
    sums = squares.sum(axis=3, dtype=np.uint16).sum(axis=1, dtype=np.uint16)
    area = supersampling**2
    mean: Image = ((sums + area // 2) // area).astype(np.uint8)
    return mean


def _made(task_name: str, look: Look) -> _Canvas:
    model = visual_model(task_name, look)
    try:
        return _Canvas(model, look)
    except Exception as error:
        raise unavailable(error) from None


def _is_size(value: object, largest: int) -> bool:
    return is_whole(value) and 0 < int(value) <= largest
