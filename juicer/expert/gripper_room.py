"""Is there room for the gripper between the parts that lie about, and over the fence?"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from juicer.expert.pose import Pose, Vector, turned
from juicer.expert.sight import Sight
from juicer.sim.scene import FENCE, FENCE_HEIGHT_M
from juicer.tasks.handling import Handling
from juicer.tasks.specification import TABLE_HEIGHT_M, AssemblyTask, PartSpec


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
REACHABLE = np.array([[0.32, -0.30], [0.50, 0.30]])
"""Robot base frame (x, y) [m]: where a tilted end effector can still pick up something that lies on the table."""


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


def solids(task: AssemblyTask, sight: Sight, grasped: int) -> list[Block]:
    """Boxes of all parts but the one to be grasped, each turned as it is, and the panels of their shells."""
    return [
        Block(sight.part(index) @ block.pose, block.half_size)
        for index, part in enumerate(task.parts)
        if index != grasped
        for block in _shape(part)
    ]


def surroundings(task: AssemblyTask, sight: Sight, grasped: int) -> list[Block]:
    """Boxes around all parts but the first and the one to be grasped, and the first part's :func:`solids`."""
    around = [
        Block(sight.part(index), np.array(part.handling.half_size_m))
        for index, part in enumerate(task.parts)
        if index != grasped and isinstance(part.handling, Handling)
    ]
    return around + [Block(sight.part(0) @ block.pose, block.half_size) for block in _shape(task.parts[0])]


@cache
def _shape(part: PartSpec) -> tuple[Block, ...]:
    """Boxes and panels of a part in its own frame; a conical shell's are upright, and as thick as it is wide."""
    up = np.array([0.0, 1.0, 0.0])
    blocks = [
        Block(Pose(np.array(box.center), turned(box.yaw_rad * up, np.eye(3))), np.array(box.half_size))
        for box in part.boxes
    ]
    for shell in part.shells:
        inner = min(shell.bottom_radius, shell.top_radius)
        outer = max(shell.bottom_radius, shell.top_radius) + shell.thickness
        half_y = (shell.top_y - shell.bottom_y) / 2
        half_size = np.array([outer * math.tan(math.pi / shell.panels), half_y, (outer - inner) / 2])
        middle = np.array([0.0, shell.bottom_y + half_y, (outer + inner) / 2])
        for panel in range(shell.panels):
            rotation = turned(2 * math.pi * panel / shell.panels * up, np.eye(3))
            blocks.append(Block(Pose(rotation @ middle, rotation), half_size))
    return tuple(blocks)


def has_room(end_effector: Pose, blocks: Sequence[Block], margin_m: float = 0.0) -> bool:
    """Whether an open gripper at a pose keeps clear of all blocks, and by how much at least."""
    return all(is_clear(Block(end_effector @ own.pose, own.half_size + margin_m), blocks) for own in _HAND)


def clears_fence(end_effector: Pose, margin_m: float = 0.0) -> bool:
    """Whether an open gripper at a pose keeps clear of every bar of the fence, and by how much at least."""
    return has_room(end_effector, _FENCE, margin_m)


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
            reachable = (place.position[:2] >= REACHABLE[0]).all() and (place.position[:2] <= REACHABLE[1]).all()
            if not reachable or not is_clear(Block(place, part.half_size), blocks):
                continue
            if has_room(Pose(end_effector.position + shift, end_effector.rotation), blocks):
                return shift
    return None


def is_clear(block: Block, others: Sequence[Block]) -> bool:
    """Whether a box touches none of the others."""
    return not any(_overlap(block, other) for other in others)


def _overlap(first: Block, second: Block) -> bool:
    """Whether two boxes touch, by the separating-axis test."""
    left, right = first.pose.rotation, second.pose.rotation
    crossed = np.cross(left.T[:, None], right.T[None]).reshape(9, 3)
    axes = np.concatenate([left.T, right.T, crossed])
    distance = np.abs(axes @ (second.pose.position - first.pose.position))
    reach = np.abs(axes @ left) @ first.half_size + np.abs(axes @ right) @ second.half_size
    return bool((distance <= reach).all())
