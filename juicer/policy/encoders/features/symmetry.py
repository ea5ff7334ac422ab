"""A part that looks the same after a turn is shown as it looks, so that what is learned at one turn is known at all."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from juicer.policy.config import FeatureSpec, SymmetrySpec
from juicer.policy.encoders.features.batched_pose import BatchedPose
from juicer.policy.rotations import euler_xyz_to_matrix, quat_to_matrix, twist_about_y


def as_they_look(
    parts: Sequence[BatchedPose], gripper: BatchedPose, spec: FeatureSpec, mounted: Tensor
) -> list[BatchedPose]:
    """Poses of all parts, those with a symmetry turned by a multiple of it, to where they are turned least.

    The first part is turned least as seen from the robot base, and what is mounted on it turns along. A part that is to
    be mounted is turned least as seen from the gripper: one stroke of a screw looks like the next.

    Args:
        parts: How they truly lie, each ``(...)``.
        gripper: Where the end effector is ``(...)``.
        spec: Numbers of the task, its symmetries among them.
        mounted: Whether each pair and all before it are mounted ``(..., pairs)``.
    """
    first, shown = parts[0], list(parts)
    if spec.symmetry is not None:
        shown[0] = _turned_least(first, first.matrix, spec.symmetry)
    comes_along = {0: torch.ones_like(mounted[..., 0])}
    for index, pair in enumerate(spec.pairs):
        part = alone = parts[pair.second]
        if pair.symmetry is not None:
            alone = _turned_least(part, part.seen_from(gripper).matrix, pair.symmetry)
        is_along = mounted[..., index] & comes_along.get(pair.first, torch.zeros_like(mounted[..., index]))
        carried = part if spec.symmetry is None else shown[0].carrying(part.seen_from(first))
        shown[pair.second], comes_along[pair.second] = _where(is_along, carried, alone), is_along
    return shown


def _turned_least(part: BatchedPose, seen: Tensor, symmetry: SymmetrySpec) -> BatchedPose:
    """The part, turned on the spot, by how its rotation ``(..., 3, 3)`` is seen."""
    straight = quat_to_matrix(seen.new_tensor(symmetry.straight))
    sine, cosine = twist_about_y(straight.T @ seen).unbind(-1)
    turn = -symmetry.every_rad * torch.round(torch.atan2(sine, cosine) / symmetry.every_rad)
    still = torch.zeros_like(turn)
    return BatchedPose(part.position, part.matrix @ euler_xyz_to_matrix(torch.stack([still, turn, still], dim=-1)))


def _where(condition: Tensor, these: BatchedPose, those: BatchedPose) -> BatchedPose:
    return BatchedPose(
        torch.where(condition[..., None], these.position, those.position),
        torch.where(condition[..., None, None], these.matrix, those.matrix),
    )
