"""What lies in the way of the first part is laid elsewhere, and that part is taken as it lies."""

from __future__ import annotations

import math

import numpy as np
import pytest

from juicer.expert.clearing import Clearing
from juicer.expert.corner import Corner
from juicer.expert.habits import Habits
from juicer.expert.laying import Laying
from juicer.expert.operator import ScriptedOperator
from juicer.expert.pair_view import downward
from juicer.expert.part_view import PartView
from juicer.expert.picking import Picking, Shift
from juicer.expert.sight import Sight
from juicer.geometry import axis_rotation, matrix_to_quat, quat_to_matrix
from juicer.seeding import stream
from juicer.sim.env import AssemblyEnv
from juicer.tasks.registry import get_task

TASK = get_task("one_leg")
HABITS = Habits.draw(np.random.default_rng(0))
CORNER = Corner(TASK, HABITS)
LEG = 4
LEG_VIEW = PartView(TASK, LEG, TASK.parts[LEG].handling)


def scene(top_yaw: float = 0.0, **placed: tuple[float, float]) -> Sight:
    """Parts at their starts, the top turned, and parts at ``(x, y)``, by name; the gripper high up and open."""
    poses = np.array([part.start for part in TASK.parts])
    poses[0, 3:] = matrix_to_quat(axis_rotation("z", top_yaw) @ quat_to_matrix(poses[0, 3:]))
    for name, position in placed.items():
        poses[("top", "leg1", "leg2", "leg3", "leg4").index(name), :2] = position
    hand = np.array([0.5, 0.0, 0.2])
    proprioception = np.concatenate([hand, downward(0.0)[:2].ravel(), np.zeros(6), [0.065]])
    return Sight(TASK, {"proprioception": proprioception, "part_poses": poses.ravel()})


def leg_in_the_way(sight: Sight) -> int | None:
    return Clearing(TASK, CORNER, HABITS).next_part(sight)


@pytest.mark.parametrize(
    ("x", "y", "is_in_the_way"),
    [
        (0.61, 0.10, True),
        (0.47, 0.08, True),
        (0.44, 0.11, False),
        (0.55, -0.16, False),
        (0.48, -0.05, False),
    ],
    ids=["in the corner", "on the way there", "where it is pushed aside", "beside the top", "on the top"],
)
def test_a_leg_is_in_the_way_if_the_top_would_take_it_into_the_corner(x, y, is_in_the_way):
    assert leg_in_the_way(scene(top=(0.48, -0.05), leg4=(x, y))) == (LEG if is_in_the_way else None)


def test_a_leg_is_laid_as_it_usually_lies_clear_of_everything():
    sight = scene(top=(0.48, -0.05), leg4=(0.61, 0.10), leg3=TASK.parts[LEG].start[:2])
    laying = Laying(TASK, LEG_VIEW, HABITS)
    place = laying.place(sight, lambda place: CORNER.keeps_clear(sight, place.position, laying.reach_m))
    assert place is not None
    assert CORNER.keeps_clear(sight, place.position, laying.reach_m)
    np.testing.assert_allclose(place.rotation[:, 1], [1.0, 0.0, 0.0], atol=1e-6)
    apart = [np.linalg.norm(place.position[:2] - sight.part(other).position[:2]) for other in (1, 2, 3)]
    assert min(apart) > 0.04


def test_a_leg_that_cannot_be_laid_anywhere_is_pushed_along():
    clearing = Clearing(TASK, CORNER, HABITS)
    sight = scene(top=(0.48, -0.05), leg4=(0.61, 0.10))
    clearing._layings[LEG].place = lambda *_: None
    assert clearing.next_part(sight) == LEG
    with pytest.raises(StopIteration):
        next(clearing.lay_aside(sight, LEG))
    assert clearing.next_part(sight) is None


def test_a_gripper_that_has_no_room_at_the_usual_grasp_takes_the_leg_farther_along():
    picking = Picking(TASK, LEG_VIEW, HABITS)
    alone = scene(leg4=(0.40, 0.0), leg3=(0.40, 0.20))
    assert picking.upright_room(alone) == Shift()
    # Of two legs side by side, one stands out by some millimetres.
    beside = scene(leg4=(0.40, 0.0), leg3=(0.445, 0.045))
    assert picking.room(beside, 0.0) is None
    shift = picking.upright_room(beside)
    assert shift is not None
    assert shift.along_m < 0


@pytest.mark.parametrize("quarter", [-1, 1, 2])
def test_the_top_is_taken_at_the_side_towards_the_robot_however_it_is_turned(quarter):
    def grasp(turn: float) -> tuple[np.ndarray, np.ndarray]:
        command = next(CORNER.push_home(scene(top_yaw=turn)))
        return command.target.position, command.target.rotation

    assert CORNER.yaw(scene(top_yaw=0.2 + quarter * math.pi / 2)) == pytest.approx(0.2, abs=1e-6)
    for straight, turned in zip(grasp(0.2), grasp(0.2 + quarter * math.pi / 2), strict=True):
        np.testing.assert_allclose(turned, straight, atol=1e-6)


@pytest.mark.parametrize(
    ("seed", "lays"), [(0, 2), (1, 2), (9, 1)], ids=["legs in the corner", "a leg by the fence", "legs side by side"]
)
def test_one_leg_is_assembled_in_each_layout_of_high_randomness(seed: int, lays: int):
    env = AssemblyEnv("one_leg", "high")
    observation, _ = env.reset(seed=seed)
    operator = ScriptedOperator(env.task, stream(0, "operator", seed))
    phases, ended = [""], False
    while not ended:
        step = operator.act(observation)
        observation, _, succeeded, gave_up, _ = env.step(step.action)
        if step.phase != phases[-1]:
            phases.append(step.phase)
        ended = succeeded or gave_up
    assert succeeded
    assert len([phase for phase in phases if phase.startswith("lay")]) == lays
