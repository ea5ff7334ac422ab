"""What the gripper holds, it holds: friction does not yield while nothing is strong enough to overcome it."""

from __future__ import annotations

import numpy as np
import pytest

BULB = 1


@pytest.mark.parametrize("beside_m", [0.012, 0.015])
def test_a_ball_that_is_not_held_at_its_middle_is_not_squeezed_out(part_over_hole, beside_m):
    # The pads end 10 mm from the hand's middle: their edges press on the ball, up to 10 degrees aslant.
    held = part_over_hole("lamp", pair=0, yaw_rad=0.0, height_m=0.1)
    across = np.array([np.cos(held.end_effector_yaw), np.sin(held.end_effector_yaw), 0.0])
    held.part_poses()[BULB, :3] += beside_m * across
    held.env.set_state(held.env.get_state())
    grip = held.action(held.end_effector(), held.end_effector_yaw, grip=1.0)
    for _ in range(5):
        held.env.step(grip)
    place = held.part_poses()[BULB, :3].copy()
    for _ in range(40):
        held.env.step(grip)
    assert np.linalg.norm(held.part_poses()[BULB, :3] - place) < 5e-4
