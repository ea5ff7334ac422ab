"""How a scene looks: plainly for policies, better for people."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Look:
    """What an image is drawn with.

    Attributes:
        robot: How the robot looks.
        is_film: Whether edges are smoothed and things cast shadows, for people. A policy's images do without: they
            cost a fraction.
    """

    robot: Literal["primitives", "mesh"] = "primitives"
    is_film: bool = False

    @property
    def samples(self) -> int:
        """Samples a pixel."""
        return 4 if self.is_film else 0
