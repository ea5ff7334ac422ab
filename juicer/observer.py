"""What a policy sees: just the observations that it declares, at the moments at which it looks."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from juicer.episode import SIMULATOR, ArraySpec, Role
from juicer.errors import ConfigError, PolicyFailed, did_you_mean
from juicer.sim.arguments import checked_count, shown
from juicer.sim.env import AssemblyEnv
from juicer.views import CAMERAS

STATE_OBSERVATIONS = tuple(spec for spec in SIMULATOR if spec.role is Role.OBSERVATION)
"""What a policy is shown that declares nothing: proprioception and part poses."""

Observations = Mapping[str, NDArray[Any]]


def image(camera: str, width: int, height: int) -> ArraySpec:
    """Specification of the image ``(height, width, 3)`` of a camera, ``front`` or ``wrist``.

    Raises:
        ConfigError: If there is no such camera, or no such size.
    """
    if camera not in CAMERAS:
        raise ConfigError(f"unknown camera {shown(camera)}{did_you_mean(str(camera), CAMERAS)}")
    width, height = checked_count("width", width), checked_count("height", height)
    return ArraySpec(camera, (height, width, 3), "uint8", Role.OBSERVATION)


class Observer:
    """Makes a policy's observations of environments, in whatever thread it is asked.

    Proprioception and part poses are what the environment shows. An array ``(height, width, 3)`` of ``uint8`` is the
    image of the camera of its name; it is drawn by the thread that owns the OpenGL context.

    Attributes:
        names: What is seen.
    """

    def __init__(self, specs: Sequence[ArraySpec]) -> None:
        """Take note of what shall be seen.

        Raises:
            PolicyFailed: If something of that cannot be observed.
        """
        self.names = tuple(spec.name for spec in specs)
        self._states: list[str] = []
        self._images: dict[str, tuple[int, int]] = {}
        for spec in specs:
            if spec in STATE_OBSERVATIONS:
                self._states.append(spec.name)
            elif (size := _image_size(spec)) is not None:
                self._images[spec.name] = size
            else:
                names = [*(each.name for each in STATE_OBSERVATIONS), *CAMERAS]
                raise PolicyFailed(
                    f"the policy asks to see {shown(spec.name)} of shape {spec.shape} and type {spec.dtype}; there are "
                    f"{', '.join(names)}, the last two as images (height, width, 3) of uint8"
                )

    def see(self, env: AssemblyEnv) -> Observations:
        """Observations of an environment's present state.

        Raises:
            RenderingUnavailable: If no OpenGL platform can draw.
            ConfigError: If an image cannot have its size.
        """
        present: dict[str, NDArray[Any]] = dict(env.observation()) if self._states else {}
        seen = {name: present[name] for name in self._states}
        for camera, (width, height) in self._images.items():
            seen[camera] = env.render_camera(camera, width, height)
        return seen


class History:
    """The last observations of one episode, as its policy is shown them.

    Attributes:
        length: Observations that are remembered, T_o.
    """

    def __init__(self, observer: Observer, env: AssemblyEnv, length: int) -> None:
        """Look for the first time."""
        self._observer = observer
        self._env = env
        self.length = length
        self._seen: deque[Observations] = deque(maxlen=length)
        self.look()

    def look(self) -> None:
        """See the present state."""
        self._seen.append(self._observer.see(self._env))

    def array(self, name: str) -> NDArray[Any]:
        """The last observations of a name, oldest first ``(T_o, ...)``.

        In front of the first stands the first again, as in the windows that policies are trained on.
        """
        missing = self.length - len(self._seen)
        seen = [observations[name] for observations in self._seen]
        return np.stack([seen[0]] * missing + seen)


def _image_size(spec: ArraySpec) -> tuple[int, int] | None:
    """Width and height of the image that is meant, if one is."""
    match spec.shape:
        case (int(height), int(width), 3) if spec.name in CAMERAS and spec.dtype == "uint8":
            return width, height
    return None
