from __future__ import annotations

import numpy as np

from juicer.gripper import gripper_commands, next_gripper_change


def actions(*gripper: float) -> np.ndarray:
    return np.array([[0.0] * 9 + [value] for value in gripper], dtype=np.float32)


def test_small_commands_keep_what_the_gripper_does():
    assert gripper_commands(actions(0.0, 1.0, 0.01, -0.02, -0.5, 0.0)).tolist() == [-1, 1, 1, 1, -1, -1]


def test_the_next_change_counts_from_the_command_in_force():
    sequence = actions(-1, 1, 0, 0, 1, -1, -1, 1)
    assert next_gripper_change(sequence, 0) == 1
    assert next_gripper_change(sequence, 2) == 5
    assert next_gripper_change(sequence, 5) == 7


def test_there_may_be_no_change_left():
    assert next_gripper_change(actions(-1, 1, 1), 1) is None
