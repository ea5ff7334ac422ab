"""The operator never ponders without doing anything: every state of the parts is answered by a command."""

from __future__ import annotations

import numpy as np
import pytest

from juicer.tasks.registry import get_task
from juicer.teleoperation.handling import HANDLINGS, Habits
from juicer.teleoperation.mounting import ScrewMounting
from juicer.teleoperation.pair_view import PairView
from juicer.teleoperation.pose import Pose
from juicer.teleoperation.scene import Scene
from juicer.teleoperation.skills import CLOSE, OPEN

TASK = get_task("one_leg")
VIEW = PairView(TASK, 0, HANDLINGS["square_table_leg4"])
MOUNTING = ScrewMounting(TASK, VIEW, Habits.draw(np.random.default_rng(0)))


def held_leg(aside_m: float, height_m: float) -> Scene:
    """A leg between the fingers, upright beside its seat."""
    poses = np.array([part.start for part in TASK.parts])

    def scene(hand: np.ndarray) -> Scene:
        rotation = np.diag([1.0, -1.0, -1.0])
        proprioception = np.concatenate([hand, rotation[:2].ravel(), np.zeros(6), [0.030]])
        return Scene(TASK, {"proprioception": proprioception, "part_poses": poses.ravel()})

    seat = VIEW.seat_pose(scene(np.zeros(3)))
    leg = seat @ Pose(np.array([aside_m, height_m, 0.0]), np.eye(3))
    index = TASK.pairs[0].second
    poses[index, :3] = leg.position
    poses[index, 3:] = poses[0, 3:]
    return scene(leg.position + np.array([0.0, 0.0, VIEW.handling.pick_m]))


@pytest.mark.parametrize(
    ("aside_m", "height_m", "gripper"),
    [(0.0, 0.05, CLOSE), (0.0, 0.01, OPEN), (0.03, 0.01, OPEN)],
    ids=["over its hole", "in its hole", "resting beside its hole"],
)
def test_a_held_leg_is_lowered_and_then_let_go(aside_m, height_m, gripper):
    scene = held_leg(aside_m, height_m)
    assert VIEW.is_held(scene)
    assert VIEW.is_engaged(scene) == (height_m < 0.02 and aside_m < 0.02)
    skill = MOUNTING.insert if VIEW.is_engaged(scene) else MOUNTING.step
    command = next(skill(scene))
    assert command.gripper == gripper
