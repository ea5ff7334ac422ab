"""The human-like operator: late, wavering, pausing, and yet it assembles."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from juicer.demonstration.recording import recordings
from juicer.expert.habits import Habits
from juicer.expert.hand import ScriptedStep
from juicer.expert.human import Human, HumanHand
from juicer.expert.operator import scripted_operators
from juicer.expert.pair_view import downward
from juicer.expert.pose import Pose
from juicer.expert.sight import Sight
from juicer.expert.skills import CLOSE, OPEN, Command, Pace, Skill, near, reach
from juicer.expert.steady import Steady
from juicer.sim.env import STEP_S
from juicer.tasks.registry import TASK_NAMES, get_task

CALM = Human(
    tremor_m=0,
    tremor_rad=0,
    reaction_steps=0,
    tempo=1,
    tempo_spread=0,
    tempo_drift=0,
    hesitation=0,
    bend_rad=0,
)
"""Nothing human about it: what a test is about is added."""

START = np.array([0.5, 0.0, 0.12])
AHEAD = np.array([0.02, 0.0, 0.0])


def sight(position: NDArray[np.float64] = START, velocity: NDArray[np.float64] | None = None) -> Sight:
    velocity = np.zeros(6) if velocity is None else velocity
    proprioception = np.concatenate([position, downward(0.3)[:2].ravel(), velocity, [0.065]])
    return Sight(get_task("one_leg"), {"proprioception": proprioception, "part_poses": np.zeros(35)})


def hand_of(reaction: int = 0, seed: int = 0, **changes: float) -> HumanHand:
    return HumanHand(np.random.default_rng(seed), CALM.model_copy(update=changes), reaction)


def go(phase: str = "push the base", gripper: float = OPEN, lead: NDArray[np.float64] = AHEAD):
    return lambda seen: Command(Pose(seen.end_effector.position + lead, seen.end_effector.rotation), gripper, phase)


def leads(hand: HumanHand, steps: int, phase: str = "push the base", lead: NDArray[np.float64] = AHEAD) -> np.ndarray:
    return np.array([hand.act(sight(), go(phase, lead=lead)).action[:3] - START for _ in range(steps)])


def moved_by(hand: HumanHand, skill: Skill, steps: int) -> NDArray[np.float64]:
    """Way of an end effector that makes half of every lead, from the start on, along x."""
    position, velocity, way = START, np.zeros(6), []
    first = [next(skill)]

    def decide(seen: Sight) -> Command:
        return first.pop() if first else skill.send(seen)

    for _ in range(steps):
        step = hand.act(sight(position, velocity), decide)
        move = 0.5 * (step.action[:3] - position)
        position, velocity = position + move, np.concatenate([move / STEP_S, np.zeros(3)])
        way.append(float(position[0]))
    return np.array(way)


def test_what_is_decided_was_seen_some_steps_ago_and_is_added_to_where_the_end_effector_is_now():
    hand, seen = hand_of(reaction=2), []

    def decide(now: Sight) -> Command:
        seen.append(float(now.end_effector.position[0]))
        return go()(now)

    places = [START + 0.01 * step * np.array([1.0, 0, 0]) for step in range(5)]
    actions = [hand.act(sight(place), decide).action[0] for place in places]
    assert seen == pytest.approx([0.50, 0.50, 0.50, 0.51, 0.52])
    np.testing.assert_allclose(actions, [place[0] + 0.02 for place in places], atol=1e-6)


def test_overshoot_and_correction_come_of_the_delay_alone():
    goal = Pose(START + np.array([0.1, 0, 0]), downward(0.3))

    def way(reaction: int) -> NDArray[np.float64]:
        skill = reach(sight(), lambda _: goal, OPEN, Pace(0.02, 0.3), near(lambda _: goal, -1, 0), "go")
        return moved_by(hand_of(reaction), skill, 60) - goal.position[0]

    assert way(0).max() < 1e-3
    late = way(1)
    assert late.max() > 2e-3
    assert np.abs(late[-5:]).max() < 1e-3


def test_the_pace_varies_within_a_phase():
    lengths = np.linalg.norm(leads(hand_of(tempo_drift=0.2), 60), axis=1)
    assert 0.002 < lengths.std() < 0.006
    # As a hand's does: little from one step to the next.
    assert np.diff(lengths).std() < 0.7 * lengths.std()


def test_a_pause_is_recorded_and_stands_still_with_a_trembling_hand():
    hand = hand_of(hesitation=1, letting_go=0, pause=8.0, pause_spread=0.0, tremor_m=1e-3)
    steps = [hand.act(sight(), go()) for _ in range(9)]
    offsets = np.array([step.action[:3] - START for step in steps])
    assert not any(step.idle for step in steps)
    assert np.abs(offsets[:8]).max() < 5e-3
    assert offsets[:8].std() > 2e-4
    assert offsets[8, 0] > 0.01


def test_a_hand_that_lets_go_of_the_device_is_idle_and_repeats_its_action():
    hand = hand_of(hesitation=1, letting_go=1, pause=5.0, pause_spread=0.0, tremor_m=1e-3)
    _first_pause = [hand.act(sight(), go("go to the leg")) for _ in range(6)]
    last = hand.act(sight(), go("go to the leg"))
    idle = [hand.act(sight(), go("grasp the leg", CLOSE)) for _ in range(5)]
    assert all(step.idle for step in idle)
    for step in idle:
        np.testing.assert_array_equal(step.action, last.action)
    assert hand.act(sight(), go("grasp the leg", CLOSE)).action[9] == CLOSE


def test_who_grasps_waits_until_the_fingers_can_be_seen_to_move():
    hand, asked = hand_of(reaction=2), []

    def decide(seen: Sight) -> Command:
        asked.append(len(actions))
        return go("grasp the leg", CLOSE)(seen)

    actions: list[ScriptedStep] = []
    for _ in range(6):
        actions.append(hand.act(sight(), decide))
    assert asked == [0, 3, 4, 5]
    assert {float(step.action[9]) for step in actions} == {CLOSE}


def test_ways_through_the_air_are_bent_to_either_side_and_straight_near_the_goal():
    bends = [leads(hand_of(seed=seed, bend_rad=0.4), 1, "go to the leg")[0] for seed in range(20)]
    sides = [math.atan2(lead[1], lead[0]) for lead in bends]
    assert min(sides) < -0.1
    assert max(sides) > 0.1
    np.testing.assert_allclose(np.linalg.norm(bends, axis=1), 0.02, atol=1e-6)
    near_it = leads(hand_of(seed=int(np.argmax(sides)), bend_rad=0.4), 1, "go to the leg", 0.1 * AHEAD)[0]
    assert math.atan2(near_it[1], near_it[0]) < 0.2 * max(sides)
    assert leads(hand_of(bend_rad=0.4), 1, "push the base")[0, 1] == pytest.approx(0, abs=1e-6)


def test_ways_are_the_steady_operators_unless_there_is_more_choice():
    steady, wide = ([Habits.draw(np.random.default_rng(seed), variety) for seed in range(50)] for variety in (1.0, 2.0))
    assert steady == [Steady().habits(np.random.default_rng(seed)) for seed in range(50)]
    assert np.ptp([each.via[1] for each in wide]) == pytest.approx(2 * np.ptp([each.via[1] for each in steady]))
    # Beyond it the wrist comes to its limit.
    assert [each.tilt_rad for each in wide] == [each.tilt_rad for each in steady]


def test_a_grasp_is_turned_only_as_far_as_the_part_looks_the_same():
    turns = {Human().habits(np.random.default_rng(seed)).turn(math.pi / 8) for seed in range(50)}
    assert turns == {-math.pi / 8, 0.0, math.pi / 8} or len(turns) == 5
    assert {Human().habits(np.random.default_rng(seed)).turn(2 * math.pi) for seed in range(50)} == {0.0}
    assert Steady().habits(np.random.default_rng(0)).turn(math.pi / 8) == 0


def test_who_reacts_late_approaches_with_more_care():
    habits = [Human(reaction_steps=4).habits(np.random.default_rng(seed)) for seed in range(30)]
    gains = {each.reaction_steps: each.pace.gain for each in habits}
    assert sorted(gains) == [1, 2, 3, 4]
    assert sorted(gains.values(), reverse=True) == [gains[reaction] for reaction in sorted(gains)]


def test_it_assembles_and_its_recordings_depend_on_the_seed_alone():
    first, again = (next(recordings("one_leg", "low", [5001], scripted_operators(0, Human()))) for _ in range(2))
    assert first.success
    assert first.idle.any()
    np.testing.assert_array_equal(first.steps["action"], again.steps["action"])


@pytest.mark.slow
@pytest.mark.parametrize("randomness", ["low", "med"])
@pytest.mark.parametrize("task", TASK_NAMES)
def test_it_assembles_more_often_than_not(task: str, randomness: str):
    logs = recordings(task, randomness, range(8000, 8010), scripted_operators(0, Human()), workers=2)
    assert sum(log.success for log in logs) >= 6
