"""A scripted pair of hands: looks at the numbers that the page shows, and presses keys as a person would.

It decides by the scripted operator, which sees the observation and nothing else, and has keys for each axis in two
speeds instead of a target that it may choose freely.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from juicer.expert.operator import ScriptedOperator
from juicer.geometry import matrix_to_rotvec, rot6d_to_matrix
from juicer.seeding import stream
from juicer.sim.env import STEP_S
from juicer.tasks.registry import get_task
from juicer.teleoperation.key_maps import DEFAULT, Action, Motion

AXES = ("x", "y", "z", "roll", "pitch", "yaw")
STEP = np.array([DEFAULT.speeds.keyboard_m_s] * 3 + [DEFAULT.speeds.keyboard_rad_s] * 3) * STEP_S
"""By how much a held key moves the target in a control step."""
FINE = DEFAULT.speeds.slow


def key_of(meaning: str) -> str:
    """The first key of the default map that means something."""
    return next(key for key, bound in DEFAULT.keys.items() if bound == meaning)


KEYS = {
    (axis, sign): key_of(f"{name}_{way}")
    for axis, name in enumerate(AXES)
    for sign, way in ((1, "plus"), (-1, "minus"))
}
SLOW = key_of(Motion.SLOW)
GRIPPER, UNDO, DISCARD = map(key_of, (Action.GRIPPER, Action.UNDO_MORE, Action.DISCARD))


@dataclass(frozen=True)
class Keys:
    """What the hands do until they look again: keys to be held, and whether the gripper's key is pressed once."""

    held: frozenset[str]
    toggles: bool


class Hands:
    """One operator's, for one demonstration."""

    def __init__(self, task: str, seed: int) -> None:
        """Draw the habits of this demonstration."""
        self._task, self._rng = get_task(task), stream(seed, "hands")
        self.begin_anew()

    def begin_anew(self) -> None:
        """Forget what one was about to do: the world is not as it was."""
        self._operator = ScriptedOperator(self._task, self._rng)
        self._rest = np.zeros(6)

    def look(self, shown: Mapping[str, NDArray[np.float32]], gripper_closes: bool) -> Keys:
        """Decide on what to press until the next look.

        Args:
            shown: The observation that the page shows.
            gripper_closes: Whether the page says that the gripper is closed.
        """
        wanted = self._operator.act(shown).action.astype(np.float64)
        now = shown["proprioception"].astype(np.float64)
        turn = matrix_to_rotvec(rot6d_to_matrix(wanted[3:9]) @ rot6d_to_matrix(now[3:9]).T)
        # In steps of a key; what a press leaves over is remembered for a while.
        wish = np.concatenate([wanted[:3] - now[:3], turn]) / STEP
        fine = bool(np.abs(wish).max() < 0.5)
        unit = FINE if fine else 1.0
        total = wish + self._rest
        pressed = np.where(np.abs(total) > unit / 2, np.sign(total), 0)
        self._rest = 0.5 * np.clip(total - unit * pressed, -unit / 2, unit / 2)
        held = {KEYS[axis, int(sign)] for axis, sign in enumerate(pressed) if sign}
        return Keys(frozenset(held | ({SLOW} if fine else set())), bool(wanted[9] > 0) != gripper_closes)
