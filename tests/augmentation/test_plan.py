from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from juicer.augmentation.config import BESIDE, FAR, NEAR, TURNED, DepartureConfig
from juicer.augmentation.plan import draw_kind, plan_departure, reverse
from juicer.geometry import matrix_to_rot6d, rot6d_to_matrix, rotation_angle, rotvec_to_matrix

START_ROTATION = rotvec_to_matrix(np.array([3.0, 0.4, 0.1]))
START = np.concatenate([[0.5, 0.1, 0.08], matrix_to_rot6d(START_ROTATION)])

WIDE = DepartureConfig(
    lift_m=(0.0, 0.18),
    distance_m=(0.2, 0.5),
    polar_deg=(5.0, 80.0),
    rotation_deg=180.0,
    step_m=(0.02, 0.02),
    step_deg=(7.5, 7.5),
)


def plan(config: DepartureConfig, seed: int = 0) -> NDArray[np.float64]:
    return plan_departure(START, config, np.random.default_rng(seed))


def path(config: DepartureConfig, seed: int = 0) -> NDArray[np.float64]:
    return np.concatenate([START[None], plan(config, seed)])


@pytest.mark.parametrize("config", [NEAR, BESIDE, TURNED, FAR, WIDE])
@pytest.mark.parametrize("seed", range(20))
def test_no_step_is_longer_than_allowed(config: DepartureConfig, seed: int):
    poses = path(config, seed)
    assert np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1).max() <= config.step_m[1] + 1e-9
    rotations = rot6d_to_matrix(poses[:, 3:])
    assert np.degrees(rotation_angle(rotations[:-1], rotations[1:])).max() <= config.step_deg[1] + 1e-6


@pytest.mark.parametrize("seed", range(20))
def test_the_hand_moves_off_into_the_cone(seed: int):
    config = FAR.model_copy(update={"lift_m": (0.03, 0.03)})
    end = path(config, seed)[-1]
    away = end[:3] - START[:3] - (0, 0, 0.03)
    distance = np.linalg.norm(away)
    assert config.distance_m[0] <= distance <= config.distance_m[1]
    polar = np.degrees(np.arccos(away[2] / distance))
    assert config.polar_deg[0] - 1e-6 <= polar <= config.polar_deg[1] + 1e-6


def test_it_lifts_before_anything_else():
    config = FAR.model_copy(update={"lift_m": (0.03, 0.03), "step_m": (0.01, 0.01)})
    targets = plan(config)
    np.testing.assert_allclose(targets[:3, :3], START[:3] + np.outer([0.01, 0.02, 0.03], [0, 0, 1]))
    np.testing.assert_allclose(targets[:3, 3:], np.tile(START[3:], (3, 1)), atol=1e-12)


def test_it_turns_on_the_spot():
    targets = plan(FAR, seed=3)
    turning = np.any(np.abs(np.diff(targets[:, 3:], axis=0)) > 1e-9, axis=1)
    assert turning.any()
    np.testing.assert_allclose(np.diff(targets[:, :3], axis=0)[turning], 0, atol=1e-12)


def test_it_turns_farther_about_the_grippers_axis_than_it_tilts():
    ends = [START_ROTATION.T @ rot6d_to_matrix(path(TURNED, seed)[-1, 3:]) for seed in range(100)]
    tilts = np.degrees([np.arccos(end[2, 2].clip(-1, 1)) for end in ends])
    yaws = np.degrees([np.arctan2(end[1, 0], end[0, 0]) for end in ends])
    assert tilts.max() <= np.hypot(4, 4)
    assert -45 <= yaws.min() < -40
    assert 40 < yaws.max() <= 45


def test_without_a_bound_of_its_own_yaw_has_that_of_the_others():
    ends = [START_ROTATION.T @ rot6d_to_matrix(path(NEAR, seed)[-1, 3:]) for seed in range(100)]
    yaws = np.degrees([np.arctan2(end[1, 0], end[0, 0]) for end in ends])
    assert 3.5 < np.abs(yaws).max() <= 4.1


def test_it_descends_at_the_end():
    config = BESIDE.model_copy(update={"lift_m": (0.01, 0.01), "descent_m": (0.015, 0.015), "polar_deg": (90.0, 90.0)})
    poses = path(config)
    assert poses[-1, 2] == pytest.approx(START[2] - 0.005)
    assert poses[:, 2].max() == pytest.approx(START[2] + 0.01)


def test_no_target_is_one_that_the_environment_refuses():
    far_out = np.concatenate([[0.8, 0.1, 0.5], START[3:]])
    targets = [plan_departure(far_out, WIDE, np.random.default_rng(seed)) for seed in range(20)]
    assert max(np.abs(values).max() for values in targets) == 1.0


def test_nothing_to_do_is_no_departure():
    still = DepartureConfig(
        lift_m=(0, 0), distance_m=(0, 0), polar_deg=(0, 0), rotation_deg=0, step_m=(0.01, 0.01), step_deg=(5, 5)
    )
    assert plan(still).shape == (0, 9)


def test_directions_are_spread_all_around():
    ends = np.array([path(NEAR, seed)[-1, :2] - START[:2] for seed in range(200)])
    quadrants = np.unique(np.sign(ends), axis=0, return_counts=True)[1]
    assert len(quadrants) == 4
    assert quadrants.min() > 30


def test_the_draws_decide_the_plan():
    np.testing.assert_array_equal(plan(FAR, 5), plan(FAR, 5))
    assert not np.allclose(plan(FAR, 5)[-1], plan(FAR, 6)[-1])


def test_the_way_back_ends_at_the_critical_pose():
    achieved = path(FAR)
    back = reverse(achieved)
    assert len(back) == len(achieved) - 1
    np.testing.assert_array_equal(back[0], achieved[-2])
    np.testing.assert_array_equal(back[-1], START)
    assert len(reverse(START[None])) == 0


def test_kinds_are_drawn_by_weight():
    kinds = {"often": FAR.model_copy(update={"weight": 3.0}), "seldom": NEAR}
    rng = np.random.default_rng(0)
    drawn = [draw_kind(kinds, rng) for _ in range(2000)]
    assert drawn.count("often") / len(drawn) == pytest.approx(0.75, abs=0.04)
