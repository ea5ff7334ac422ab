"""The quick functions on single poses agree with the vectorised geometry."""

from __future__ import annotations

import math

import numpy as np
import pytest

from juicer import geometry
from juicer.expert.pose import (
    UP,
    Pose,
    angle_between,
    heading,
    matrix_of_rows,
    pose_of,
    shortened,
    turn_between,
    turned,
    wrapped,
)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def random_quat(rng: np.random.Generator) -> np.ndarray:
    return geometry.normalised(rng.normal(size=4))


def test_a_pose_reads_position_and_quaternion(rng):
    quat = random_quat(rng)
    pose = pose_of([0.1, -0.2, 0.3, *quat])
    np.testing.assert_allclose(pose.position, [0.1, -0.2, 0.3])
    np.testing.assert_allclose(pose.rotation, geometry.quat_to_matrix(quat), atol=1e-12)


def test_rows_of_a_rotation_give_it_back(rng):
    matrix = geometry.quat_to_matrix(random_quat(rng))
    np.testing.assert_allclose(matrix_of_rows(geometry.matrix_to_rot6d(matrix)), matrix, atol=1e-12)


def test_a_pose_composed_with_its_inverse_is_none(rng):
    pose = Pose(rng.normal(size=3), geometry.quat_to_matrix(random_quat(rng)))
    nothing = pose @ pose.inverse()
    np.testing.assert_allclose(nothing.position, 0, atol=1e-12)
    np.testing.assert_allclose(nothing.rotation, np.eye(3), atol=1e-12)


@pytest.mark.parametrize("angle", [0.0, 1e-8, 1e-3, 1.0, 3.0, math.pi - 1e-7, math.pi])
def test_turning_by_the_turn_between_two_rotations_leads_to_the_goal(rng, angle: float):
    for _ in range(20):
        start = geometry.quat_to_matrix(random_quat(rng))
        goal = geometry.rotvec_to_matrix(angle * geometry.normalised(rng.normal(size=3))) @ start
        turn = turn_between(start, goal)
        assert np.linalg.norm(turn) == pytest.approx(angle, abs=1e-6)
        np.testing.assert_allclose(turned(turn, start), goal, atol=1e-6)


def test_shortening_keeps_the_direction_and_spares_short_vectors():
    np.testing.assert_allclose(shortened(np.array([3.0, 0, 4.0]), 1.0), [0.6, 0, 0.8])
    np.testing.assert_allclose(shortened(np.array([0.1, 0, 0]), 1.0), [0.1, 0, 0])


def test_angles():
    assert angle_between(UP, -UP) == pytest.approx(math.pi)
    assert heading(np.array([0.0, 2.0, 5.0])) == pytest.approx(math.pi / 2)
    assert wrapped(3 * math.pi / 2) == pytest.approx(-math.pi / 2)
    assert wrapped(math.radians(50), math.pi / 2) == pytest.approx(math.radians(-40))
