"""Skills lead the hand where they should, in a world where it makes half of every lead."""

from __future__ import annotations

import contextlib
import math

import numpy as np
import pytest

from juicer.expert.pair_view import downward
from juicer.expert.pose import Pose, length, turn_between, turned
from juicer.expert.sight import Sight
from juicer.expert.skills import (
    CLOSE,
    OPEN,
    Pace,
    Patience,
    Skill,
    Stall,
    descend,
    grip,
    near,
    reach,
    rise,
    towards,
)
from juicer.sim.env import STEP_S
from juicer.tasks.registry import get_task

PACE = Pace(lead_m=0.02, lead_rad=0.3)
START = Pose(np.array([0.5, 0.0, 0.12]), downward(0.3))


class World:
    """A hand that makes half of the lead it is given, and fingers that move 20 mm a step."""

    def __init__(self, hand: Pose = START, narrowest_m: float = 0.0) -> None:
        self.hand, self.width, self.narrowest_m = hand, 0.065, narrowest_m
        self.velocity = np.zeros(6)
        self.path = [hand]

    def scene(self) -> Sight:
        rows = self.hand.rotation[:2].ravel()
        proprioception = np.concatenate([self.hand.position, rows, self.velocity, [self.width]])
        return Sight(get_task("one_leg"), {"proprioception": proprioception, "part_poses": np.zeros(35)})

    def run(self, skill: Skill, longest: int = 300) -> int:
        """Obey a skill to its end; the number of steps."""
        try:
            command = next(skill)
            for _ in range(longest):
                move = 0.5 * (command.target.position - self.hand.position)
                turn = 0.5 * turn_between(self.hand.rotation, command.target.rotation)
                self.hand = Pose(self.hand.position + move, turned(turn, self.hand.rotation))
                self.velocity = np.concatenate([move, turn]) / STEP_S
                change = -0.02 if command.gripper > 0 else 0.02
                self.width = min(max(self.width + change, self.narrowest_m), 0.065)
                self.path.append(self.hand)
                command = skill.send(self.scene())
        except StopIteration:
            return len(self.path) - 1
        raise AssertionError(f"the skill did not end in {longest} steps")


def test_a_target_never_leads_further_than_the_pace_allows():
    world = World()
    world.velocity = np.full(6, 1.0)
    target = towards(world.scene(), Pose(np.array([0.9, 0.3, 0.5]), downward(2.5)), PACE)
    assert length(target.position - START.position) <= PACE.lead_m + 1e-12
    assert length(turn_between(START.rotation, target.rotation)) <= PACE.lead_rad + 1e-9


def test_a_movement_starts_gently():
    target = towards(World().scene(), Pose(np.array([0.9, 0.0, 0.12]), START.rotation), PACE)
    assert length(target.position - START.position) == pytest.approx(PACE.start_m)


def test_reaching_arrives_with_translation_and_rotation_together():
    world = World()
    goal = Pose(np.array([0.60, 0.05, 0.10]), downward(1.0))
    steps = world.run(reach(world.scene(), lambda _: goal, OPEN, PACE, near(lambda _: goal, 0.002, 0.02), "go"))
    assert steps < 40
    half_way = next(pose for pose in world.path if length(pose.position - goal.position) < 0.05)
    assert 0.1 < length(turn_between(half_way.rotation, goal.rotation)) < 0.6


def test_descending_stays_high_until_it_is_over_the_grasp():
    world = World()
    grasp = Pose(np.array([0.60, 0.05, 0.02]), downward(0.8))
    world.run(descend(world.scene(), lambda _: grasp, 0.06, PACE, "go"))
    for pose in world.path:
        aside = math.hypot(*(pose.position - grasp.position)[:2])
        assert pose.position[2] > 0.06 or aside < 0.05
    assert near(lambda _: grasp, 0.004, math.radians(3))(world.scene())


def test_descending_gives_up_where_something_stops_the_hand():
    world = World()
    blocked = world.scene()
    skill = descend(blocked, lambda _: Pose(np.array([0.5, 0.0, 0.0]), START.rotation), 0.06, PACE, "go")
    next(skill)
    sent = 0
    with contextlib.suppress(StopIteration):
        for _ in range(20):
            skill.send(blocked)
            sent += 1
    assert sent < 20


@pytest.mark.parametrize(("play_m", "goes_up"), [(0.004, False), (0.002, True)])
def test_fingers_that_came_down_on_a_tight_part_go_up_again(play_m, goes_up):
    world = World(hand=Pose(np.array([0.505, 0.0, 0.017]), START.rotation))
    grasp = Pose(np.array([0.5, 0.0, 0.0]), START.rotation)
    command = next(descend(world.scene(), lambda _: grasp, 0.06, PACE, "go", play_m))
    assert (command.target.position[2] > world.hand.position[2]) == goes_up


def test_descending_is_begun_anew_if_it_takes_too_long():
    world = World()
    wandering = (Pose(np.array([0.5, 0.1 * (-1) ** step, 0.0]), START.rotation) for step in range(10_000))
    assert world.run(descend(world.scene(), lambda _: next(wandering), 0.06, PACE, "go"), longest=1000) < 200


def test_rising_ends_above_the_height():
    world = World()
    world.run(rise(world.scene(), 0.2, OPEN, PACE, "up"))
    assert world.hand.position[2] > 0.2
    np.testing.assert_allclose(world.hand.position[:2], START.position[:2], atol=1e-9)


def test_gripping_ends_when_done_or_when_the_fingers_stand_still():
    quick = World()
    assert quick.run(grip(quick.scene(), CLOSE, lambda scene: scene.width < 0.031, "grasp")) == 2
    blocked = World(narrowest_m=0.02)
    assert blocked.run(grip(blocked.scene(), CLOSE, lambda scene: scene.width < 0.01, "grasp")) < 8


def test_a_stall_needs_several_still_steps_in_a_row():
    stall, world = Stall(patience=3), World()
    still = world.scene()
    world.velocity = np.full(6, 1.0)
    moving = world.scene()
    assert [stall(scene) for scene in (still, still, moving, still, still, still)] == [False] * 5 + [True]


def test_patience_ends_after_its_steps():
    tired, scene = Patience(3), World().scene()
    assert [tired(scene) for _ in range(4)] == [False] * 3 + [True]
