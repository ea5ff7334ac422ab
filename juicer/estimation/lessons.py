"""Drawn scenes on disk: images in plain files that the system maps into memory, and what is true of each scene."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from juicer.views import View

DONE_FILE = "done.json"


@dataclass(frozen=True)
class Lessons:
    """Scenes with their images.

    Attributes:
        images: By view's name, ``(N, h, w, 3)`` of uint8, mapped into memory.
        observations: Proprioception ``(N, 16)`` and part poses ``(N, 7 P)``.
        critical_states: ``(N,)`` the critical state that each is close to, by its index, or -1.
    """

    images: Mapping[str, NDArray[np.uint8]]
    observations: Mapping[str, NDArray[np.float32]]
    critical_states: NDArray[np.int64]

    def __len__(self) -> int:
        """Number of scenes."""
        return len(self.critical_states)
