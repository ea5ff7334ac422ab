import numpy as np
import pytest
import torch
from pydantic import ValidationError

from juicer.geometry import (
    matrix_to_quat,
    matrix_to_rot6d,
    quat_multiply,
    quat_to_matrix,
    relative_pose,
    rotvec_to_matrix,
)
from juicer.policy.config import FeatureSpec, PairSpec
from juicer.policy.encoders.features.config import FeaturesConfig
from juicer.policy.encoders.features.features import state_features

CONFIG = FeaturesConfig()


def spec_of(*pairs, num_parts=3):
    return FeatureSpec(num_parts=num_parts, pairs=pairs, mounted_m=0.005, mounted_cosine=0.94)


def features_of(observations, spec, config=CONFIG):
    tensors = {name: torch.from_numpy(values) for name, values in observations.items()}
    return state_features(tensors, spec, config).numpy()


def moved(observations, position, quat_wxyz):
    """The same scene, seen from a robot base that stands elsewhere."""
    matrix = quat_to_matrix(np.array(quat_wxyz))

    def pose(values):
        return np.concatenate(
            [values[:, :3] @ matrix.T + position, quat_multiply(np.array(quat_wxyz), values[:, 3:])], 1
        )

    proprioception = observations["proprioception"].astype(np.float64)
    rotation = np.stack([proprioception[:, 3:6], proprioception[:, 6:9]], axis=1)
    rotation = np.concatenate([rotation, np.cross(rotation[:, 0], rotation[:, 1])[:, None]], axis=1)
    proprioception[:, :3] = proprioception[:, :3] @ matrix.T + position
    proprioception[:, 3:9] = matrix_to_rot6d(matrix @ rotation)
    parts = observations["part_poses"].astype(np.float64)
    parts = np.concatenate([pose(parts[:, :7]), pose(parts[:, 7:])], axis=1)
    return {"proprioception": proprioception.astype(np.float32), "part_poses": parts.astype(np.float32)}


def test_the_first_features_are_the_proprioception(spec, observe):
    observations = observe(5)
    np.testing.assert_array_equal(features_of(observations, spec)[:, :16], observations["proprioception"])


def test_relative_poses_agree_with_the_geometry_module(spec, observe):
    observations = observe(20)
    first, second = observations["part_poses"][:, :7], observations["part_poses"][:, 7:]
    target = np.array(spec.pairs[0].target)
    in_first = relative_pose(first.astype(np.float64), second.astype(np.float64))
    in_target = relative_pose(target, in_first)
    features = features_of(observations, spec)
    np.testing.assert_allclose(features[:, 16 + 36 : 16 + 39], in_target[:, :3], atol=1e-5)
    expected = matrix_to_rot6d(quat_to_matrix(in_target[:, 3:]))
    np.testing.assert_allclose(features[:, 16 + 39 : 16 + 45], expected, atol=1e-5)


def test_relative_features_do_not_depend_on_where_the_robot_base_stands(spec, observe):
    observations = observe(20)
    shifted = moved(observations, np.array([0.1, -0.2, 0.05]), [np.cos(0.4), 0.0, 0.0, np.sin(0.4)])
    relative = slice(16 + 18, None)
    np.testing.assert_allclose(
        features_of(observations, spec)[:, relative], features_of(shifted, spec)[:, relative], atol=2e-3
    )


def test_a_millimetre_at_the_target_is_visible(spec):
    part_poses = np.zeros((2, 14), dtype=np.float32)
    part_poses[:, [3, 10]] = 1
    part_poses[:, 7:10] = spec.pairs[0].target[:3]
    part_poses[1, 7] += 0.001
    proprioception = np.zeros((2, 16), dtype=np.float32)
    proprioception[:, [3, 7]] = 1
    at_target, beside = features_of({"proprioception": proprioception, "part_poses": part_poses}, spec)
    assert np.abs(at_target - beside).max() == pytest.approx(np.tanh(1 / 3), abs=1e-4)


def test_twist_follows_a_turning_screw_through_full_circles(spec):
    angles = np.linspace(-7, 7, 50)
    quats = np.stack([np.cos(angles / 2), 0 * angles, np.sin(angles / 2), 0 * angles], axis=1)
    part_poses = np.zeros((50, 14), dtype=np.float32)
    part_poses[:, 3] = 1
    part_poses[:, 10:] = quats
    proprioception = np.zeros((50, 16), dtype=np.float32)
    proprioception[:, [3, 7]] = 1
    twist = features_of({"proprioception": proprioception, "part_poses": part_poses}, spec)[:, -2:]
    np.testing.assert_allclose(twist, np.stack([np.sin(angles), np.cos(angles)], axis=1), atol=1e-5)


def test_tilt_does_not_disturb_the_twist(spec):
    tilted = rotvec_to_matrix(np.array([0.3, 0, 0])) @ rotvec_to_matrix(np.array([0, 1.0, 0]))
    twist = features_of(
        {
            "proprioception": np.eye(1, 16, 3, dtype=np.float32) + np.eye(1, 16, 7, dtype=np.float32),
            "part_poses": _pose_row(np.eye(3), tilted),
        },
        spec,
    )[0, -2:]
    np.testing.assert_allclose(twist, [np.sin(1.0), np.cos(1.0)], atol=1e-5)


def test_a_pair_must_name_existing_parts():
    target = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    with pytest.raises(ValidationError, match="beyond num_parts=2"):
        spec_of(PairSpec(first=0, second=2, target=target), num_parts=2)


def _pose_row(first, second):
    row = np.concatenate([np.zeros(3), matrix_to_quat(first), np.zeros(3), matrix_to_quat(second)])
    return row[None].astype(np.float32)


TARGET = (0.0, 0.05, 0.0, 1.0, 0.0, 0.0, 0.0)
LEG, BASE = PairSpec(first=0, second=1, target=TARGET), PairSpec(first=1, second=2, target=TARGET)
TWO_PAIRS = spec_of(LEG, BASE)


def stacked(leg_turned=0.0, leg_aside=0.0, base_aside=0.1):
    """Three parts, each over the other, and the hand beside them."""
    turn = matrix_to_quat(rotvec_to_matrix(np.array([0.0, leg_turned, 0.0])))
    parts = [[0, 0, 0, 1, 0, 0, 0], [leg_aside, 0.05, 0, *turn], [base_aside, 0.10, 0, 1, 0, 0, 0]]
    proprioception = np.concatenate([[0.3, 0.2, 0.1, 1, 0, 0, 0, 1, 0], np.zeros(7)])
    return {
        "proprioception": proprioception[None].astype(np.float32),
        "part_poses": np.concatenate(parts)[None].astype(np.float32),
    }


def alone(pair, observations):
    """What a policy is shown of a pair, behind the proprioception."""
    return features_of(observations, spec_of(pair))[0, 16:]


@pytest.mark.parametrize(
    ("observations", "shown", "flag"),
    [
        (stacked(leg_aside=0.006), LEG, 0.0),
        (stacked(leg_turned=0.4), LEG, 0.0),
        (stacked(leg_aside=0.004), BASE, 1.0),
        (stacked(leg_turned=0.3), BASE, 1.0),
        (stacked(base_aside=0.0), BASE, 1.0),
    ],
    ids=["aside", "turned", "within the tolerance", "turned within it", "all mounted"],
)
def test_the_first_pair_that_is_not_mounted_is_shown_and_named_and_then_the_one_before_it(observations, shown, flag):
    features = features_of(observations, TWO_PAIRS)[0]
    np.testing.assert_array_equal(features[16:], [*alone(shown, observations), *alone(LEG, observations), flag])


def test_a_part_that_may_stand_at_any_rotation_is_mounted_at_any():
    features = features_of(stacked(leg_turned=2.0), spec_of(LEG.model_copy(update={"any_rotation": True}), BASE))
    assert features[0, -1] == 1.0


def test_a_part_is_also_mounted_where_it_was_not_meant_to_go():
    aside = (0.02, *TARGET[1:])
    assert features_of(stacked(leg_aside=0.02), TWO_PAIRS)[0, -1] == 0.0
    features = features_of(stacked(leg_aside=0.02), spec_of(LEG.model_copy(update={"also_at": (aside,)}), BASE))
    assert features[0, -1] == 1.0


def test_all_pairs_can_be_shown_side_by_side():
    everything = features_of(stacked(), TWO_PAIRS, FeaturesConfig(pairs="all"))[0]
    np.testing.assert_array_equal(everything[16:], [*alone(LEG, stacked()), *alone(BASE, stacked())])


def test_the_way_that_is_left_is_seen_from_the_gripper(spec, observe):
    observations = observe(20)
    first, second = (values.astype(np.float64) for values in np.split(observations["part_poses"], 2, axis=1))
    place = first[:, :3] + np.einsum("nij,j->ni", quat_to_matrix(first[:, 3:]), np.array(spec.pairs[0].target[:3]))
    rows = observations["proprioception"][:, 3:9].astype(np.float64).reshape(-1, 2, 3)
    hand = np.concatenate([rows, np.cross(rows[:, 0], rows[:, 1])[:, None]], axis=1)
    way = np.einsum("nij,ni->nj", hand, place - second[:, :3])
    np.testing.assert_allclose(features_of(observations, spec)[:, 16 + 45 : 16 + 48], way, atol=1e-5)
