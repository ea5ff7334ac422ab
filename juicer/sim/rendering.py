"""Pictures of a scene through whatever software or hardware OpenGL the machine offers."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from juicer.errors import ConfigError, RenderingUnavailable, did_you_mean

MAX_WIDTH, MAX_HEIGHT = 1280, 720


class CameraRenderer:
    """Draws named cameras of one model; contexts are created when the first picture is asked for."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Remember the model."""
        self._model = model
        self._renderers: dict[tuple[int, int], mujoco.Renderer] = {}

    def draw(self, data: mujoco.MjData, camera: str, width: int, height: int) -> NDArray[np.uint8]:
        """Picture ``(height, width, 3)``, without shadows and reflections (they cost seven times the rest).

        Raises:
            ConfigError: If there is no such camera.
            RenderingUnavailable: If no OpenGL platform can draw.
        """
        cameras = [self._model.camera(index).name for index in range(self._model.ncam)]
        if camera not in cameras:
            raise ConfigError(f"unknown camera '{camera}'{did_you_mean(camera, cameras)}")
        renderer = self._renderers.get((width, height)) or self._create(width, height)
        renderer.update_scene(data, camera=camera)
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = 0
        picture: NDArray[np.uint8] = renderer.render()
        return picture

    def close(self) -> None:
        """Free every context."""
        for renderer in self._renderers.values():
            renderer.close()
        self._renderers.clear()

    def _create(self, width: int, height: int) -> mujoco.Renderer:
        if not 0 < width <= MAX_WIDTH or not 0 < height <= MAX_HEIGHT:
            raise ConfigError(f"a picture may measure at most {MAX_WIDTH}x{MAX_HEIGHT}, got {width}x{height}")
        try:
            renderer = mujoco.Renderer(self._model, height=height, width=width)
        except Exception as error:  # every OpenGL platform fails in its own way
            raise RenderingUnavailable(
                f"no OpenGL platform can draw a picture here ({type(error).__name__}: {error}); "
                "set MUJOCO_GL=egl with libegl1 and libgl1-mesa-dri installed, or MUJOCO_GL=osmesa with libosmesa6"
            ) from None
        self._renderers[width, height] = renderer
        return renderer
