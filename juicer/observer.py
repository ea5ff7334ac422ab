"""What a policy sees: just the observations that it declares, at the moments at which it looks."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from juicer.episode import SIMULATOR, ArraySpec, Role
from juicer.errors import ConfigError, PolicyFailed, did_you_mean
from juicer.sim.arguments import checked_count, shown
from juicer.sim.env import AssemblyEnv
from juicer.views import CAMERAS, MAX_HEIGHT, MAX_WIDTH, ImageSpec, View

STATE_OBSERVATIONS = tuple(spec for spec in SIMULATOR if spec.role is Role.OBSERVATION)
"""What a policy is shown that declares nothing: proprioception and part poses."""

Observations = Mapping[str, NDArray[Any]]


def image(camera: str, width: int, height: int) -> ImageSpec:
    """Specification of the whole image ``(height, width, 3)`` of a camera, ``front`` or ``wrist``, by its name.

    Raises:
        ConfigError: If there is no such camera, or no such size.
    """
    if camera not in CAMERAS:
        raise ConfigError(f"unknown camera {shown(camera)}{did_you_mean(str(camera), CAMERAS)}")
    width, height = checked_count("width", width), checked_count("height", height)
    try:
        return View.model_validate({"camera": camera, "width": width, "height": height}).observed(camera)
    except ValidationError:
        largest = f"{MAX_WIDTH}x{MAX_HEIGHT}"
        raise ConfigError(f"an image measures 1x1 to {largest} pixels, got {width}x{height}") from None


class Observer:
    """Makes a policy's observations of environments, in whatever thread it is asked.

    Proprioception and part poses are what the environment shows. Images are drawn by the thread that owns the OpenGL
    context.

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
        self._views: dict[str, View] = {}
        for spec in specs:
            if spec in STATE_OBSERVATIONS:
                self._states.append(spec.name)
            elif isinstance(spec, ImageSpec):
                self._views[spec.name] = spec.view
            else:
                names = ", ".join([*(each.name for each in STATE_OBSERVATIONS), *CAMERAS])
                raise PolicyFailed(
                    f"the policy asks to see {shown(spec.name)} of shape {spec.shape} and type {spec.dtype}; there are "
                    f"{names}, the last two as images, see juicer.api.image"
                )

    @property
    def sees_images(self) -> bool:
        """Whether images are among it."""
        return bool(self._views)

    def see(self, env: AssemblyEnv) -> Observations:
        """Observations of an environment's present state.

        Raises:
            RenderingUnavailable: If no OpenGL platform can draw.
            ConfigError: If a view shows the robot's mesh, and that is not installed.
        """
        present: dict[str, NDArray[Any]] = dict(env.observation()) if self._states else {}
        seen = {name: present[name] for name in self._states}
        return seen | {name: env.render_view(view) for name, view in self._views.items()}


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
