"""Is there room for the gripper between the parts that lie about?"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from juicer.tasks.specification import AssemblyTask
from juicer.teleoperation.pose import Pose, Vector
from juicer.teleoperation.scene import Scene

# Boxes (low and high corner) of the open hand in the end-effector frame [m]: palm, two fingers.
_HAND = (
    ((-0.0316, -0.104, -0.129), (0.0316, 0.100, -0.037)),
    ((-0.009, 0.032, -0.037), (0.009, 0.048, 0.0095)),
    ((-0.009, -0.048, -0.037), (0.009, -0.032, 0.0095)),
)
_MARGIN_M = 0.003
_SAMPLES = np.stack(np.meshgrid(*[np.linspace(-1.0, 1.0, 5)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)

_SHIFTS_M = (0.03, 0.05, 0.07, 0.09)
_DIRECTIONS = np.array([[math.cos(angle), math.sin(angle), 0.0] for angle in np.arange(8) * math.pi / 4])
# Robot base frame (x, y): where a tilted hand can still pick up something that lies on the table.
_REACHABLE = np.array([[0.32, -0.30], [0.50, 0.30]])


def has_room(hand: Pose, obstacles: NDArray[np.float64]) -> bool:
    """Whether an open hand at a pose keeps clear of all points.

    Args:
        hand: Pose of the end effector.
        obstacles: Points ``(N, 3)`` of the robot base frame, see :func:`obstacle_points`.
    """
    points = (obstacles - hand.position) @ hand.rotation
    return not any(
        bool(((points > np.array(low) - _MARGIN_M) & (points < np.array(high) + _MARGIN_M)).all(axis=1).any())
        for low, high in _HAND
    )


def obstacle_points(task: AssemblyTask, scene: Scene, grasped: int) -> NDArray[np.float64]:
    """Points ``(N, 3)`` in the boxes of all parts but the one to be grasped."""
    clouds = []
    for index, part in enumerate(task.parts):
        if index != grasped:
            pose = scene.part(index)
            clouds += [
                pose.position + (np.array(box.center) + _SAMPLES * np.array(box.half_size)) @ pose.rotation.T
                for box in part.boxes
            ]
    return np.concatenate(clouds)


def nearest_room(hand: Pose, part: Pose, part_half_size: Vector, obstacles: NDArray[np.float64]) -> Vector | None:
    """Shortest shift along the table by which a part gets clear of the others, and a hand that grasps it too.

    Args:
        hand: Pose of the hand that would grasp the part where it is.
        part: The part's pose.
        part_half_size: Half extents of a box around it.
        obstacles: Points ``(N, 3)`` of the robot base frame.
    """
    for distance in _SHIFTS_M:
        for direction in _DIRECTIONS:
            shift: Vector = distance * direction
            place = part.position + shift
            if (place[:2] < _REACHABLE[0]).any() or (place[:2] > _REACHABLE[1]).any():
                continue
            inside = np.abs((obstacles - place) @ part.rotation) < part_half_size + _MARGIN_M
            if not inside.all(axis=1).any() and has_room(Pose(hand.position + shift, hand.rotation), obstacles):
                return shift
    return None
