"""Parts that look the same after a turn: what a policy is shown of them does not depend on it."""

import math

import numpy as np
import pytest
import torch

from juicer.geometry import matrix_to_rot6d, quat_multiply, quat_to_matrix
from juicer.policy.encoders.features.batched_pose import BatchedPose
from juicer.policy.encoders.features.config import FeaturesConfig
from juicer.policy.encoders.features.features import state_features
from juicer.policy.encoders.features.symmetry import as_they_look
from juicer.policy.feature_spec import feature_spec
from juicer.tasks.furniture_bench import axis_turn
from juicer.tasks.registry import get_task

SPEC = feature_spec("round_table")
UP = np.array((math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0))
"""Rotation of a part whose y axis points upwards."""
FIRST_ROTATION = slice(19, 25)
WHICH = -1
"""The last feature: whether the second pair is next."""


def scene(turn_deg=0.0, leg_deg=0.0, base_deg=20.0):
    """Top and base upright, the leg lying, each turned about its own axis."""
    top = (0.52, 0.03, 0.0, *quat_multiply(UP, np.array(axis_turn(turn_deg))))
    lying = quat_multiply(np.array((0.6, 0.0, 0.0, 0.8)), np.array((0.9, 0.1, 0.0, math.sqrt(0.18))))
    leg = (0.41, 0.14, 0.02, *quat_multiply(lying, np.array(axis_turn(leg_deg))))
    base = (0.42, -0.12, 0.01, *quat_multiply(UP, np.array(axis_turn(base_deg))))
    return np.array((*top, *leg, *base))


def mount(poses, pair_index, extra_deg=0.0):
    """The same scene with the second part of a pair in its place, screwed in by so many degrees too little."""
    pair, poses = SPEC.pairs[pair_index], poses.copy()
    first, target = poses[7 * pair.first : 7 * pair.first + 7], np.array(pair.target)
    position = first[:3] + quat_to_matrix(first[3:]) @ target[:3]
    rotation = quat_multiply(quat_multiply(first[3:], target[3:]), np.array(axis_turn(extra_deg)))
    poses[7 * pair.second : 7 * pair.second + 7] = (*position, *rotation)
    return poses


def shown(poses, spec=SPEC, config=None, yaw_deg=0.0):
    """Features, with the gripper pointing down."""
    yaw, proprioception = math.radians(yaw_deg), np.zeros((1, 16))
    proprioception[0, [0, 3, 4, 6, 7]] = 0.5, math.cos(yaw), math.sin(yaw), math.sin(yaw), -math.cos(yaw)
    observations = {"proprioception": proprioception, "part_poses": poses[None]}
    tensors = {name: torch.from_numpy(values.astype(np.float32)) for name, values in observations.items()}
    return state_features(tensors, spec, config or FeaturesConfig())[0].numpy()


@pytest.mark.parametrize("pairs", ["next", "all"])
@pytest.mark.parametrize("turns", [-3, -1, 2, 12])
def test_a_round_top_is_shown_as_it_looks(turns, pairs):
    config = FeaturesConfig(pairs=pairs)
    turned = shown(scene(4.0 + 15.0 * turns), config=config)
    np.testing.assert_allclose(turned, shown(scene(4.0), config=config), atol=1e-5)


def test_a_turn_that_can_be_seen_is_shown():
    assert np.abs(shown(scene(4.0)) - shown(scene(0.0))).max() > 0.05


@pytest.mark.parametrize("pairs", ["next", "all"])
@pytest.mark.parametrize(("leg_deg", "base_deg"), [(30.0, 0.0), (-60.0, 90.0), (0.0, -180.0)])
def test_a_part_that_is_to_be_mounted_is_shown_as_fingers_find_it(leg_deg, base_deg, pairs):
    config = FeaturesConfig(pairs=pairs)
    turned = shown(scene(leg_deg=leg_deg, base_deg=20.0 + base_deg), config=config)
    np.testing.assert_allclose(turned, shown(scene(), config=config), atol=1e-5)


def test_one_stroke_of_a_screw_looks_like_the_next():
    """What the gripper sees of a base when it has turned it, and is back over its next arms."""
    base_seen = slice(16 + 27, 16 + 36)  # of a part that is next, from the gripper
    begun = shown(mount(mount(scene(), 0), 1, extra_deg=-200.0), yaw_deg=10.0)[base_seen]
    after = shown(mount(mount(scene(), 0), 1, extra_deg=-110.0), yaw_deg=10.0)[base_seen]
    np.testing.assert_allclose(begun, after, atol=1e-5)


@pytest.mark.parametrize("task", ["one_leg", "round_table", "square_table"])
@pytest.mark.parametrize("yaw_deg", [-30.0, 0.0, 55.0])
@pytest.mark.parametrize("play_deg", [-5.0, 5.0])
def test_a_part_that_is_held_flat_is_shown_as_it_lies(task, yaw_deg, play_deg):
    """Half a symmetry away from there lie the turns at which what is shown changes: never in the hand."""
    spec, yaw = feature_spec(task), math.radians(yaw_deg)
    down = np.array([[math.cos(yaw), math.sin(yaw), 0], [math.sin(yaw), -math.cos(yaw), 0], [0, 0, -1.0]])
    gripper = batched(np.zeros(3), down)
    for pair in spec.pairs:
        play = quat_to_matrix(np.array(axis_turn(play_deg)))
        held = batched(np.ones(3), down @ quat_to_matrix(np.array(pair.symmetry.straight)) @ play)
        assert abs(float(held.matrix[2, 1])) > 0.999  # its axis is upright
        looks = as_they_look([held] * spec.num_parts, gripper, spec, torch.zeros(len(spec.pairs), dtype=torch.bool))
        torch.testing.assert_close(looks[pair.second].matrix, held.matrix)


def batched(position, matrix):
    return BatchedPose(torch.from_numpy(position), torch.from_numpy(matrix))


def test_parts_may_be_shown_as_they_lie():
    config, pairs = FeaturesConfig(symmetry=False), tuple(p.model_copy(update={"symmetry": None}) for p in SPEC.pairs)
    truly = SPEC.model_copy(update={"symmetry": None, "pairs": pairs})
    poses = scene(40.0, 80.0, 110.0)
    np.testing.assert_array_equal(shown(poses, config=config), shown(poses, truly))
    assert np.abs(shown(poses) - shown(poses, truly)).max() > 0.2


def test_what_is_mounted_turns_along():
    def mounted(turn_deg):
        return mount(scene(turn_deg), 0)

    first = shown(mounted(-3.0))
    assert first[WHICH] == 1
    np.testing.assert_allclose(shown(mounted(-3.0 + 45.0)), first, atol=1e-5)


def test_a_leg_that_is_not_screwed_home_is_not_mounted_however_it_looks():
    """30 degrees short, it stands in a top that looks as if it were turned by 30 degrees and the leg were home."""
    short = shown(mount(scene(30.0), 0, extra_deg=-30.0))
    assert short[WHICH] == 0
    assert shown(mount(scene(30.0), 0))[WHICH] == 1


def test_a_file_of_before_tells_of_no_symmetry():
    """Its policy sees parts as they lie, as it did."""
    pairs = {"pairs": {"__all__": {"symmetry"}}}
    before = type(SPEC).model_validate(SPEC.model_dump(exclude={"symmetry": True, **pairs}))
    assert before.symmetry is None
    assert [pair.symmetry for pair in before.pairs] == [None, None]


@pytest.mark.parametrize(
    ("task", "degrees"), [("one_leg", None), ("round_table", 15), ("lamp", 90), ("square_table", None)]
)
def test_only_a_part_whose_places_lie_on_its_axis_has_a_symmetry(task, degrees):
    symmetry = feature_spec(task).symmetry
    assert degrees == (symmetry and pytest.approx(math.degrees(symmetry.every_rad)))


@pytest.mark.parametrize("task", ["round_table", "lamp"])
def test_a_part_in_its_mean_pose_is_shown_straight(task):
    """Half a symmetry away from there lie the turns at which what is shown changes."""
    spec, poses = feature_spec(task), np.concatenate([part.start for part in get_task(task).parts])
    straight = matrix_to_rot6d(quat_to_matrix(np.array(spec.symmetry.straight)))
    np.testing.assert_allclose(shown(poses, spec)[FIRST_ROTATION], straight, atol=1e-6)
