"""What the operator reads off a scene."""

from __future__ import annotations

import math

import numpy as np
import pytest

from juicer.expert.corner import Corner
from juicer.expert.habits import Habits
from juicer.expert.pair_view import STROKE_END_RAD, PairView, downward
from juicer.expert.pose import Pose, pose_of
from juicer.expert.sight import Sight
from juicer.geometry import axis_rotation, matrix_to_quat
from juicer.tasks.registry import get_task

TASK = get_task("one_leg")
VIEW = PairView(TASK, 0, TASK.parts[4].handling)
CORNER = Corner(TASK, Habits.draw(np.random.default_rng(0)))
HOME_XY = CORNER.home_xy
PAIR = TASK.pairs[0]


def scene_with(
    leg_in_seat: np.ndarray | None = None,
    top_yaw: float = 0.0,
    top_xy: tuple[float, float] = (HOME_XY[0], HOME_XY[1]),
    width: float = 0.065,
    hand: Pose | None = None,
    lean: float = 0.0,
) -> Sight:
    """Parts at their starts but for the top, and the leg displaced from its seat if that is given."""
    poses = np.array([part.start for part in TASK.parts])
    top = pose_of(poses[0])
    top = Pose(np.array([*top_xy, top.position[2]]), axis_rotation("z", top_yaw) @ top.rotation)
    poses[0] = [*top.position, *matrix_to_quat(top.rotation)]
    if leg_in_seat is not None:
        seat = np.array(PAIR.targets[PAIR.operator_target][:3])
        leg = top @ Pose(seat + leg_in_seat, axis_rotation("x", lean))
        poses[4] = [*leg.position, *matrix_to_quat(leg.rotation)]
    hand = hand or Pose(np.array([0.5, 0.0, 0.1]), downward(0.5))
    proprioception = np.concatenate([hand.position, hand.rotation[:2].ravel(), np.zeros(6), [width]])
    return Sight(TASK, {"proprioception": proprioception, "part_poses": poses.ravel()})


def test_the_top_is_home_in_the_corner_only():
    assert CORNER.is_home(scene_with(), 0.005, 0.05)
    assert not CORNER.is_home(scene_with(top_xy=(HOME_XY[0] - 0.02, HOME_XY[1])), 0.005, 0.05)
    assert not CORNER.is_home(scene_with(top_yaw=0.2), 0.005, 0.05)
    assert CORNER.yaw(scene_with(top_yaw=0.2)) == pytest.approx(0.2, abs=1e-6)


@pytest.mark.parametrize("top_yaw", [0.0, 0.4])
def test_the_seat_is_measured_in_the_tops_frame(top_yaw: float):
    seat = VIEW.seat(scene_with(np.array([0.003, 0.01, 0.004]), top_yaw, lean=0.1))
    assert seat.aside_m == pytest.approx(0.005, abs=1e-6)
    assert seat.height_m == pytest.approx(0.01, abs=1e-6)
    assert seat.lean_rad == pytest.approx(0.1, abs=1e-5)


def test_a_leg_is_engaged_in_its_hole_and_not_above_or_beside_it():
    assert VIEW.is_engaged(scene_with(np.array([0.0, 0.008, 0.0]), lean=0.2))
    assert not VIEW.is_engaged(scene_with(np.array([0.0, 0.03, 0.0])))
    assert not VIEW.is_engaged(scene_with(np.array([0.05, 0.0, 0.0])))
    assert not VIEW.is_engaged(scene_with())


def test_a_leg_is_held_if_the_fingers_close_on_it():
    leg = pose_of(TASK.parts[4].start)
    at_leg = Pose(leg.position + np.array([0.012, 0.0, 0.003]), downward(0.0))
    assert VIEW.is_held(scene_with(hand=at_leg, width=0.0297))
    assert not VIEW.is_held(scene_with(hand=at_leg, width=0.065))
    assert not VIEW.is_held(scene_with(width=0.0297))


def test_a_stroke_starts_flat_on_the_leg_a_quarter_turn_before_its_end():
    for lean_free_yaw in (0.0, 0.3, -0.6):
        scene = scene_with(np.array([0.0, 0.008, 0.0]), top_yaw=lean_free_yaw)
        start, end = VIEW.stroke_start(scene), STROKE_END_RAD
        assert math.radians(45) <= start - end <= math.radians(135)
        leg_face = math.atan2(VIEW.part(scene).rotation[1, 0], VIEW.part(scene).rotation[0, 0])
        assert math.sin(2 * (start - leg_face)) == pytest.approx(0, abs=1e-6)


def test_the_leg_is_stood_up_with_the_hand_leading_away_from_the_robot():
    rotation = VIEW.upright(scene_with(np.array([0.0, 0.05, 0.0])))
    np.testing.assert_allclose(rotation[:, 1], [0, 0, 1], atol=1e-6)


def test_a_downward_hand_points_down_and_is_a_rotation():
    rotation = downward(0.7)
    np.testing.assert_allclose(rotation[:, 2], [0, 0, -1])
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
