"""How a scene looks: plainly for policies, better for people."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Look:
    """What an image is drawn with.

    Attributes:
        robot: How the robot looks.
        for_people: Whether edges are smoothed and things cast shadows, for people. A policy's images do without: they
            cost a fraction.
    """

    robot: Literal["primitives", "mesh"] = "primitives"
    for_people: bool = False

    @property
    def samples(self) -> int:
        """Samples a pixel."""
        return 4 if self.for_people else 0
