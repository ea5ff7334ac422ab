"""State features: what a network is shown of proprioception and part poses.

A difference of 2 mm is 0.007 of a workspace scaled to [-1, 1], invisible to a smooth network, while insertion
is decided by it. The relative poses that decide are therefore shown again in saturated fine-scale copies,
tanh(x / scale). They are functions of the observed poses and nothing more.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import torch
from torch import Tensor, nn

from juicer.episode import PROPRIOCEPTION_SIZE
from juicer.policy.actions import POSITION, ROTATION
from juicer.policy.config import FeatureSpec, PairSpec, Target
from juicer.policy.encoders.features.batched_pose import BatchedPose
from juicer.policy.encoders.features.config import FeaturesConfig
from juicer.policy.encoders.features.symmetry import as_they_look
from juicer.policy.rotations import quat_to_matrix, rot6d_to_matrix, twist_about_y
from juicer.policy.tasks import size_of_part_poses

_SATURATED = 0.85
"""From where on a coarser copy tells more."""
_PLAIN_NUMBERS, _FINE_NUMBERS, _ROTATION_NUMBERS = 48, 12, 8
"""Of a pair: five poses and a way; a finer copy of its offsets, for each scale; finer axes and the twist."""


def state_features(observations: Mapping[str, Tensor], spec: FeatureSpec, config: FeaturesConfig) -> Tensor:
    """Features ``(..., F)`` of observations ``(..., D)``; the first 16 are the proprioception itself.

    Of the pair that is next to be mounted, and of the one before it, follow: both parts' poses in the robot base
    frame; both seen from the gripper; the second part seen from its target in the first; the way it still has to go,
    as seen from the gripper, in whose frame actions may be given; the fine-scale copies of these offsets, of the second
    part's axis as seen from the gripper and from the target, with its twist about that axis as sine and cosine. Last
    comes which pair is next, one number for each but the first.

    So what is learned of one leg is known of all legs, and parts that do not matter now cannot mislead.
    ``config.pairs`` may ask for all pairs side by side instead. Unless ``config.symmetry`` is off, parts are shown as
    they look (:func:`juicer.policy.encoders.features.symmetry.as_they_look`); which pair is next is decided by how they
    truly lie.
    """
    proprioception, part_poses = observations["proprioception"], observations["part_poses"]
    gripper = BatchedPose(proprioception[..., POSITION], rot6d_to_matrix(proprioception[..., ROTATION]))
    parts = [_part_pose(part_poses, index) for index in range(spec.num_parts)]
    mounted = torch.stack([_is_mounted(_placed(parts, pair), spec) for pair in spec.pairs], dim=-1)
    in_order = mounted.long().cumprod(dim=-1)
    if config.symmetry:
        parts = as_they_look(parts, gripper, spec, in_order.bool())
    pairs = [_pair_features(gripper, _placed(parts, pair), config) for pair in spec.pairs]
    if config.pairs == "all":
        return torch.cat([proprioception, *pairs], dim=-1)
    following = in_order.sum(dim=-1).clamp(max=len(pairs) - 1)
    # The first pair stands for the one before it, and a single one is shown once.
    shown = torch.stack([following, (following - 1).clamp(min=0)], dim=-1)[..., : len(pairs), None]
    which = nn.functional.one_hot(following, len(pairs))[..., 1:]
    features = torch.take_along_dim(torch.stack(pairs, dim=-2), shown, dim=-2).flatten(-2)
    return torch.cat([proprioception, features, which], dim=-1)


def num_features(spec: FeatureSpec, config: FeaturesConfig) -> int:
    """How many features a task has."""
    sizes = {"proprioception": PROPRIOCEPTION_SIZE, "part_poses": size_of_part_poses(spec)}
    blank = {name: torch.zeros(1, size) for name, size in sizes.items()}
    return state_features(blank, spec, config).shape[-1]


def num_choices(spec: FeatureSpec, config: FeaturesConfig) -> int:
    """Among how many pairs the one that is next is told, by the last features: one number for each but the first."""
    return len(spec.pairs) if config.pairs == "next" else 1


class SeenPair(NamedTuple):
    """What features tell of a pair.

    Attributes:
        offsets_m: Where the first part is as seen from the gripper, the second from there, and the second from its
            target ``(..., 3, 3)`` [m].
        axes: Their y axes, as seen from there ``(..., 3, 3)``.
    """

    offsets_m: Tensor
    axes: Tensor


def read_pair(features: Tensor, config: FeaturesConfig, place: int = 0) -> SeenPair:
    """Read features ``(..., F)`` back, each coordinate of an offset from its finest copy that does not saturate.

    Args:
        features: See :func:`state_features`.
        config: Which features they are.
        place: Of the pair among those that are shown.
    """
    size = _PLAIN_NUMBERS + _FINE_NUMBERS * len(config.fine_scales_m) + _ROTATION_NUMBERS
    numbers, shape = features[..., PROPRIOCEPTION_SIZE + place * size :], features.shape[:-1]
    # Of five poses, the last three; each is an offset and a rotation.
    poses = numbers[..., 18:45].reshape(*shape, 3, 9)
    offsets = poses[..., :3]
    for number, scale_m in sorted(enumerate(config.fine_scales_m), key=lambda each: -each[1]):
        start = _PLAIN_NUMBERS + _FINE_NUMBERS * number
        copy = numbers[..., start : start + 9].reshape(*shape, 3, 3).clamp(-_SATURATED, _SATURATED)
        is_told = offsets.abs() < scale_m * math.atanh(_SATURATED)
        offsets = torch.where(is_told, copy.atanh() * scale_m, offsets)
    return SeenPair(offsets, rot6d_to_matrix(poses[..., 3:])[..., :, 1])


class _PlacedPair(NamedTuple):
    """A pair in a scene: its parts, where the second belongs, and the second seen from there."""

    spec: PairSpec
    first: BatchedPose
    second: BatchedPose
    goal: BatchedPose
    joint: BatchedPose


def _placed(parts: Sequence[BatchedPose], pair: PairSpec) -> _PlacedPair:
    first, second = parts[pair.first], parts[pair.second]
    goal = _place(first, pair.target)
    return _PlacedPair(pair, first, second, goal, second.seen_from(goal))


def _place(first: BatchedPose, target: Target) -> BatchedPose:
    pose = first.position.new_tensor(target)
    return first.carrying(BatchedPose(pose[:3], quat_to_matrix(pose[3:])))


def _is_mounted(pair: _PlacedPair, spec: FeatureSpec) -> Tensor:
    others = [pair.second.seen_from(_place(pair.first, target)) for target in pair.spec.also_at]
    return torch.stack([_is_in_place(joint, pair.spec, spec) for joint in (pair.joint, *others)]).any(dim=0)


def _is_in_place(joint: BatchedPose, pair: PairSpec, spec: FeatureSpec) -> Tensor:
    near = joint.position.abs().amax(dim=-1) <= spec.mounted_m
    if pair.any_rotation:
        return near
    return near & (joint.matrix.diagonal(dim1=-2, dim2=-1).amin(dim=-1) >= spec.mounted_cosine)


def _pair_features(gripper: BatchedPose, pair: _PlacedPair, config: FeaturesConfig) -> Tensor:
    joint = pair.joint
    first_seen, second_seen = pair.first.seen_from(gripper), pair.second.seen_from(gripper)
    poses = (pair.first, pair.second, first_seen, second_seen, joint)
    way = pair.goal.seen_from(gripper).position - second_seen.position
    offsets = torch.cat([first_seen.position, second_seen.position, joint.position, way], dim=-1)
    axes = torch.cat([second_seen.matrix[..., :, 1], joint.matrix[..., :, 1]], dim=-1)
    return torch.cat(
        [
            *(number for pose in poses for number in pose.numbers()),
            way,
            *(torch.tanh(offsets / scale_m) for scale_m in config.fine_scales_m),
            torch.tanh(axes / config.tilt_scale),
            twist_about_y(joint.matrix),
        ],
        dim=-1,
    )


def _part_pose(part_poses: Tensor, index: int) -> BatchedPose:
    pose = part_poses[..., 7 * index : 7 * index + 7]
    return BatchedPose(pose[..., :3], quat_to_matrix(pose[..., 3:]))
