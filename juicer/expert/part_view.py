"""What an operator makes of a part by itself: where is it, is it held?"""

from __future__ import annotations

import numpy as np

from juicer.expert.pose import Pose
from juicer.expert.sight import Sight
from juicer.tasks.handling import Handling
from juicer.tasks.specification import AssemblyTask

_FINGER_TIP_M = 0.014
"""How far the fingers reach below the end effector's own point, and a little more."""
OPEN_SHARE = 0.89


class PartView:
    """Reads a scene for one part that can be picked up."""

    def __init__(self, task: AssemblyTask, part_index: int, handling: Handling) -> None:
        """Look at a part of ``task``."""
        self.part_index = part_index
        self.handling = handling
        self.open_width_m = OPEN_SHARE * task.gripper_width_m

    def part(self, sight: Sight) -> Pose:
        """Pose of the part."""
        return sight.part(self.part_index)

    def clear_of_part(self, sight: Sight) -> float:
        """Height at which an end effector passes over the part [m]."""
        part = self.part(sight)
        half_m = float(np.abs(part.rotation[2]) @ self.handling.half_size_m)
        return float(part.position[2]) + half_m + _FINGER_TIP_M

    def is_held(self, sight: Sight) -> bool:
        """Whether the gripper holds the part."""
        width = self.handling.pick_width_m
        if not width - 0.003 < sight.width < width + 0.0035:
            return False
        x, y, z = (self.part(sight).inverse() @ sight.end_effector).position.tolist()
        return bool(max(abs(x), abs(z)) < 0.012 and -0.0365 < y - self.handling.pick_m < 0.0235)

    def is_closed_on_part(self, sight: Sight) -> bool:
        """Whether the fingers have closed as far as the part between them lets them."""
        return sight.width < max(self.handling.pick_width_m, self.handling.screw_width_m) + 0.0006

    def is_open(self, sight: Sight) -> bool:
        """Whether the gripper is open."""
        return sight.width > self.open_width_m
