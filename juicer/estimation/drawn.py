"""What an estimator learns from: images of displaced states, and what is true of each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class DrawnStates:
    """States, each drawn in every view.

    Attributes:
        images: By view's name, ``(N, h, w, 3)``.
        observations: Proprioception ``(N, 16)`` and part poses ``(N, 7 P)`` by name.
        critical_states: ``(N,)`` the critical state that each is close to, by its index, or -1.
        drawn_by: What has drawn the images, in the words of OpenGL platforms.
    """

    images: Mapping[str, NDArray[np.uint8]]
    observations: Mapping[str, NDArray[np.float32]]
    critical_states: NDArray[np.int64]
    drawn_by: tuple[str, ...] = ()

    def __len__(self) -> int:
        """Number of states."""
        return len(self.critical_states)
