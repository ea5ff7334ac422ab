"""The operator never ponders without doing anything: every state of the parts is answered by a command."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from juicer.expert.habits import Habits
from juicer.expert.mounting import ScrewMounting
from juicer.expert.operator import ScriptedOperator
from juicer.expert.pair_view import PairView
from juicer.expert.pose import Pose, turn_between
from juicer.expert.sight import Sight
from juicer.expert.skills import CLOSE, OPEN
from juicer.seeding import stream
from juicer.sim.env import AssemblyEnv
from juicer.tasks.registry import get_task

TASK = get_task("one_leg")
VIEW = PairView(TASK, 0, TASK.parts[4].handling)
MOUNTING = ScrewMounting(TASK, VIEW, Habits.draw(np.random.default_rng(0)))


def held_leg(aside_m: float, height_m: float) -> Sight:
    """A leg between the fingers, upright beside its seat."""
    poses = np.array([part.start for part in TASK.parts])

    def scene(hand: np.ndarray) -> Sight:
        rotation = np.diag([1.0, -1.0, -1.0])
        proprioception = np.concatenate([hand, rotation[:2].ravel(), np.zeros(6), [0.030]])
        return Sight(TASK, {"proprioception": proprioception, "part_poses": poses.ravel()})

    seat = VIEW.seat_pose(scene(np.zeros(3)))
    leg = seat @ Pose(np.array([aside_m, height_m, 0.0]), np.eye(3))
    index = TASK.pairs[0].second
    poses[index, :3] = leg.position
    poses[index, 3:] = poses[0, 3:]
    return scene(leg.position + np.array([0.0, 0.0, VIEW.handling.pick_m]))


@pytest.mark.parametrize(
    ("aside_m", "height_m", "gripper"),
    [(0.0, 0.05, CLOSE), (0.0, 0.0175, CLOSE), (0.0, 0.01, OPEN), (0.03, 0.01, OPEN)],
    ids=["over its hole", "on its first turn, where it could fall out", "in its hole", "resting beside its hole"],
)
def test_a_held_leg_is_lowered_and_then_let_go(aside_m, height_m, gripper):
    scene = held_leg(aside_m, height_m)
    assert VIEW.is_held(scene)
    assert VIEW.is_engaged(scene) == (height_m < 0.02 and aside_m < 0.02)
    skill = MOUNTING.insert if VIEW.is_engaged(scene) else MOUNTING.step
    command = next(skill(scene))
    assert command.gripper == gripper


@pytest.mark.parametrize(("height_m", "rocks"), [(0.030, False), (0.0175, True), (0.008, False)])
def test_a_leg_is_rocked_away_from_the_robot_where_it_would_stand_on_its_thread(height_m, rocks):
    scene = held_leg(0.0, height_m)
    target = next(MOUNTING.insert(scene)).target
    about = turn_between(scene.end_effector.rotation, target.rotation)
    assert about[[0, 2]] == pytest.approx(0.0, abs=1e-6)
    assert about[1] > math.radians(2) if rocks else about[1] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("aside_m", "least_m", "most_m"),
    [(0.001, -0.02, -0.003), (0.004, -0.008, -0.001), (0.008, -0.001, 0.001), (0.020, 0.003, 0.02)],
    ids=["aligned", "not aligned yet", "aside", "astray"],
)
def test_a_leg_over_its_hole_sinks_while_it_is_aligned_and_rises_only_far_astray(aside_m, least_m, most_m):
    scene = held_leg(aside_m, VIEW.depth_m + 0.005)
    rise = next(MOUNTING.insert(scene)).target.position[2] - scene.end_effector.position[2]
    assert least_m <= rise <= most_m


def test_every_part_of_a_lamp_is_taken_up_once_and_brought_by_an_arm_that_can_move_on():
    env = AssemblyEnv("lamp")
    # From 7004 on: its operator would tilt the hand that picks up the bulb until the palm lies on the fence.
    seed = next(seed for seed in itertools.count(7004) if not Habits.draw(stream(0, "operator", seed)).fumbles)
    operator = ScriptedOperator(env.task, stream(0, "operator", seed))
    observation, _ = env.reset(seed=seed)
    lowest, highest = env.model.jnt_range[:7].T
    phases, ended, room_rad = [], False, math.pi
    while not ended:
        step = operator.act(observation)
        phases.append(step.phase)
        if step.phase.startswith("insert"):
            joints = env.data.qpos[:7]
            room_rad = min(room_rad, (joints - lowest).min(), (highest - joints).min())
        observation, _, succeeded, gave_up, _ = env.step(step.action)
        ended = succeeded or gave_up
    assert succeeded
    assert room_rad > math.radians(15)
    assert max(len(list(steps)) for _, steps in itertools.groupby(phases)) < 100
    begun = [phase for phase, last in zip(phases, ["", *phases], strict=False) if phase != last]
    assert [phase for phase in begun if phase.startswith("grasp the")] == [
        "grasp the base",
        "grasp the bulb",
        "grasp the hood",
    ]
    assert not {phase for phase in begun if phase.startswith(("let go", "take"))}


@pytest.mark.parametrize(
    ("name", "depths_mm"),
    [("one_leg", [24.94]), ("round_table", [26.25, 27.5]), ("lamp", [31.0, 6.5]), ("square_table", 4 * [24.94])],
)
def test_the_funnel_ends_where_the_tip_of_the_peg_meets_the_rim(name, depths_mm):
    task = get_task(name)
    views = [PairView(task, index, task.parts[pair.second].handling) for index, pair in enumerate(task.pairs)]
    assert [1e3 * view.depth_m for view in views] == pytest.approx(depths_mm)


def test_a_hand_that_closed_too_early_opens_and_comes_down_again():
    leg = TASK.pairs[0].second
    seed = next(seed for seed in itertools.count() if leg in Habits.draw(stream(0, "operator", seed)).fumbles)
    env = AssemblyEnv("one_leg")
    operator = ScriptedOperator(env.task, stream(0, "operator", seed))
    observation, _ = env.reset(seed=seed)
    start = observation["part_poses"].reshape(-1, 7)[leg, :3]
    phases, empty_handed_in, moved_m, milestones = [""], set(), 0.0, {}
    while "leg_lifted" not in milestones:
        step = operator.act(observation)
        observation, *_, info = env.step(step.action)
        milestones = info["milestones"]
        if step.phase != phases[-1]:
            phases.append(step.phase)
        if observation["proprioception"][15] < 0.002:
            empty_handed_in.add(step.phase)
            moved_m = float(np.linalg.norm(observation["part_poses"].reshape(-1, 7)[leg, :3] - start))
    assert empty_handed_in == {"grasp the leg"}
    assert phases[-6:] == ["go to the leg", "grasp the leg", "let go", "go to the leg", "grasp the leg", "lift the leg"]
    assert moved_m < 0.001
