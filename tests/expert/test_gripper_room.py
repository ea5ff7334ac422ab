"""Whether a hand fits between parts."""

from __future__ import annotations

import math

import numpy as np

from juicer.expert.gripper_room import Block, clears_fence, has_room, nearest_room, obstacles, solids
from juicer.expert.pair_view import downward
from juicer.expert.pose import UP, Pose, turned
from juicer.expert.sight import Sight
from juicer.tasks.registry import get_task

HAND = Pose(np.array([0.4, 0.0, 0.0]), downward(0.0))
LEG = np.array([0.015, 0.03, 0.015])


def block(x: float, y: float, z: float, half_size: np.ndarray = LEG, yaw: float = 0.0) -> Block:
    return Block(Pose(np.array([x, y, z]), turned(yaw * UP, np.eye(3))), half_size)


def test_an_upright_hand_reaches_over_low_neighbours():
    assert has_room(HAND, [block(0.4, 0.1, 0.0), block(0.47, 0.0, 0.0)])


def test_a_neighbour_between_or_at_the_fingers_is_in_the_way():
    assert not has_room(HAND, [block(0.4, 0.055, 0.0)])


def test_a_tall_neighbour_is_in_the_way_of_the_palm():
    tall = np.array([0.015, 0.015, 0.05])
    assert not has_room(HAND, [block(0.4, 0.08, 0.0, tall)])
    assert has_room(HAND, [block(0.4, 0.13, 0.0, tall)])


def test_only_the_corner_of_a_turned_block_counts():
    long = np.array([0.08, 0.003, 0.05])
    assert has_room(HAND, [block(0.4, 0.19, 0.0, long, yaw=0.0)])
    assert not has_room(HAND, [block(0.4, 0.16, 0.0, long, yaw=math.pi / 2)])


def test_a_hand_tilted_too_far_beside_the_fence_lies_on_it_with_its_palm():
    def hand(x: float, tilt_rad: float) -> Pose:
        return Pose(np.array([x, 0.175, 0.01]), turned(tilt_rad * np.array([0.0, 1.0, 0.0]), downward(0.0)))

    assert not clears_fence(hand(0.478, math.radians(52)))
    assert clears_fence(hand(0.478, math.radians(35)))
    assert clears_fence(hand(0.40, math.radians(52)))


def test_room_may_be_asked_for_with_a_margin():
    neighbour = [block(0.4, 0.081, 0.0)]
    assert has_room(HAND, neighbour)
    assert not has_room(HAND, neighbour, 0.005)


def test_the_rim_of_a_round_top_is_in_the_way_where_it_is_and_not_where_its_box_would_be():
    task = get_task("round_table")
    poses = np.array([part.start for part in task.parts])
    proprioception = np.concatenate([HAND.position, HAND.rotation[:2].ravel(), np.zeros(6), [0.065]])
    sight = Sight(task, {"proprioception": proprioception, "part_poses": poses.ravel()})
    middle = sight.part(0).position

    def hand(distance: float, angle: float) -> Pose:
        return Pose(
            middle + distance * np.array([math.cos(angle), math.sin(angle), 0.1]), downward(angle + math.pi / 2)
        )

    over_the_rim = hand(0.135, 0.4)
    assert has_room(over_the_rim, obstacles(task, sight, grasped=1)[:4])
    assert not has_room(over_the_rim, solids(task, sight, grasped=1))
    assert has_room(hand(0.17, 0.4), solids(task, sight, grasped=1))


def test_a_part_is_shifted_as_little_as_gives_room():
    neighbour = block(0.4, 0.055, 0.0)
    shift = nearest_room(HAND, block(0.4, 0.0, 0.0), [neighbour])
    assert shift is not None
    assert np.linalg.norm(shift) == 0.03
    assert has_room(Pose(HAND.position + shift, HAND.rotation), [neighbour])


def test_there_may_be_no_room_at_all():
    everywhere = block(0.4, 0.0, 0.0, np.array([1.0, 1.0, 0.1]))
    assert nearest_room(HAND, block(0.4, 0.0, 0.0), [everywhere]) is None
