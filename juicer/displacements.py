"""How far things may stand from where they were recorded. Data only: nothing is displaced here."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from juicer.config import StrictConfig

Length = Annotated[float, Field(ge=0, le=1)]
Angle = Annotated[float, Field(ge=0, le=1)]


class Displacements(StrictConfig):
    """Largest standard deviations on each axis: metres and radians.

    Each state draws its own, down to zero: most stay close to what was recorded, some are far from it.
    """

    gripper_m: Length = Field(default=0.03, description="of the gripper, and of what it holds")
    gripper_rad: Angle = 0.2
    slip_m: Length = Field(default=0.004, description="of a held part, as seen from the gripper")
    slip_rad: Angle = 0.12
    base_m: Length = Field(default=0.012, description="of the first part along the table, with all that stands in it")
    base_rad: Angle = 0.1
    part_m: Length = Field(default=0.008, description="of another part along the table")
    part_rad: Angle = 0.15
