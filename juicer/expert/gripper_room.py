"""Is there room for the gripper between the parts that lie about, and over the fence?"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from juicer.expert.pose import Pose, Vector
from juicer.expert.sight import Sight
from juicer.sim.scene import FENCE, FENCE_HEIGHT_M
from juicer.tasks.specification import TABLE_HEIGHT_M, AssemblyTask


@dataclass(frozen=True)
class Block:
    """A box somewhere.

    Attributes:
        pose: Its centre and axes.
        half_size: Half extents along them [m].
    """

    pose: Pose
    half_size: Vector


# The open gripper in the end-effector frame: palm, two fingers.
_HAND = (
    Block(Pose(np.array([0.0, -0.002, -0.083]), np.eye(3)), np.array([0.0316, 0.102, 0.046])),
    Block(Pose(np.array([0.0, 0.040, -0.014]), np.eye(3)), np.array([0.009, 0.008, 0.023])),
    Block(Pose(np.array([0.0, -0.040, -0.014]), np.eye(3)), np.array([0.009, 0.008, 0.023])),
)
# A little higher than it is: an arm does not go exactly where it is told.
_FENCE = tuple(
    Block(
        Pose(np.array([*center, TABLE_HEIGHT_M + FENCE_HEIGHT_M / 2]), np.eye(3)),
        np.array([*half_size, FENCE_HEIGHT_M / 2 + 0.003]),
    )
    for center, half_size in FENCE
)
_SHIFTS_M = (0.03, 0.05, 0.07, 0.09)
_DIRECTIONS = np.array([[math.cos(angle), math.sin(angle), 0.0] for angle in np.arange(8) * math.pi / 4])
# Robot base frame (x, y): where a tilted end effector can still pick up something that lies on the table.
_REACHABLE = np.array([[0.32, -0.30], [0.50, 0.30]])


def obstacles(task: AssemblyTask, sight: Sight, grasped: int) -> list[Block]:
    """Boxes of all parts but the one to be grasped.

    An approximation: each box lies along its part's axes, whatever its yaw, and balls and shells do not count.
    """
    return [
        Block(sight.part(index) @ Pose(np.array(box.center), np.eye(3)), np.array(box.half_size))
        for index, part in enumerate(task.parts)
        if index != grasped
        for box in part.boxes
    ]


def has_room(end_effector: Pose, blocks: Sequence[Block]) -> bool:
    """Whether an open gripper at a pose keeps clear of all blocks."""
    return all(_is_clear(Block(end_effector @ own.pose, own.half_size), blocks) for own in _HAND)


def clears_fence(end_effector: Pose) -> bool:
    """Whether an open gripper at a pose touches no bar of the fence."""
    return has_room(end_effector, _FENCE)


def nearest_room(end_effector: Pose, part: Block, blocks: Sequence[Block]) -> Vector | None:
    """Shortest shift along the table by which a part gets clear of the others, and an end effector that grasps it too.

    Args:
        end_effector: Pose of the end effector that would grasp the part where it is.
        part: Box around the part.
        blocks: Everything else.
    """
    for distance in _SHIFTS_M:
        for direction in _DIRECTIONS:
            shift: Vector = distance * direction
            place = Pose(part.pose.position + shift, part.pose.rotation)
            reachable = (place.position[:2] >= _REACHABLE[0]).all() and (place.position[:2] <= _REACHABLE[1]).all()
            if not reachable or not _is_clear(Block(place, part.half_size), blocks):
                continue
            if has_room(Pose(end_effector.position + shift, end_effector.rotation), blocks):
                return shift
    return None


def _is_clear(block: Block, others: Sequence[Block]) -> bool:
    return not any(_overlap(block, other) for other in others)


def _overlap(first: Block, second: Block) -> bool:
    """Whether two boxes touch, by the separating-axis test."""
    left, right = first.pose.rotation, second.pose.rotation
    crossed = np.cross(left.T[:, None], right.T[None]).reshape(9, 3)
    axes = np.concatenate([left.T, right.T, crossed])
    distance = np.abs(axes @ (second.pose.position - first.pose.position))
    reach = np.abs(axes @ left) @ first.half_size + np.abs(axes @ right) @ second.half_size
    return bool((distance <= reach).all())
