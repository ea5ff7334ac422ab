"""What the gripper is told by actions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

GRIPPER_ENTRY = 9
"""Index of the gripper's command in an action."""

GRIPPER_DEADBAND = 0.02
"""Commands up to this size keep what the gripper does."""


def gripper_commands(actions: NDArray[np.generic]) -> NDArray[np.float64]:
    """Command in force at each step ``(T,)``, +1 close or -1 open, from actions ``(T, 10)``.

    Steps before the first clear command count as open, as the gripper is at reset.
    """
    told = np.asarray(actions[:, GRIPPER_ENTRY], dtype=np.float64)
    clear = np.abs(told) > GRIPPER_DEADBAND
    latest = np.maximum.accumulate(np.where(clear, np.arange(len(told)), -1))
    return np.where(latest >= 0, np.sign(told[np.maximum(latest, 0)]), -1.0)


def next_gripper_change(actions: NDArray[np.generic], step: int) -> int | None:
    """First step after ``step`` whose command differs from the one in force at ``step``; None if none does."""
    commands = gripper_commands(actions)
    changed = np.flatnonzero(commands[step:] != commands[step])
    return step + int(changed[0]) if len(changed) else None
