"""Small skills that any assembly is composed of.

A skill is a generator: it yields one command a control step, is sent what is seen after it, and returns the last
thing seen. Commands depend on what is seen and hardly on how long a skill has run, for a policy that shall imitate
them sees no more than that: a target is a bounded lead over the end effector's present pose, as the deflection of a
human's SpaceMouse gives it, and a skill ends where the scene shows that it is done.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from dataclasses import dataclass, replace

from juicer.expert.pose import UP, Pose, Vector, length, shortened, turn_between, turned
from juicer.expert.sight import Sight
from juicer.sim.env import STEP_S

OPEN, CLOSE = -1.0, 1.0

# A target that leads the end effector by 10 mm moves it by about 5 mm in a control step.
_FOLLOWING = 0.5
_STILL_FINGERS_M = 2e-4
_PLAY_M = 0.004
_STILL_M_S, _STILL_RAD_S = 0.006, 0.05


@dataclass(frozen=True)
class Command:
    """What the operator does for one control step.

    Attributes:
        target: Where the end effector shall go.
        gripper: +1 closes, -1 opens.
        phase: What the operator is busy with.
    """

    target: Pose
    gripper: float
    phase: str


@dataclass(frozen=True)
class Pace:
    """How boldly the operator moves.

    Attributes:
        lead_m: Longest lead of the target over the end effector; the end effector makes about half of it in a step.
        lead_rad: The same for rotation.
        start_m: Lead at the beginning of a movement; it grows with the end effector's speed.
        start_rad: The same for rotation.
        gain: Lead for a unit of distance to the goal; above one it overcomes the arm's lag near the goal.
    """

    lead_m: float
    lead_rad: float
    start_m: float = 0.008
    start_rad: float = 0.10
    gain: float = 1.5

    def at_most(self, lead_m: float) -> Pace:
        """The same pace with a shorter longest lead."""
        return replace(self, lead_m=min(self.lead_m, lead_m), start_m=min(self.start_m, lead_m))


Skill = Generator[Command, Sight, Sight]
Goal = Callable[[Sight], Pose]
Test = Callable[[Sight], bool]


def towards(sight: Sight, goal: Pose, pace: Pace) -> Pose:
    """Target that leads the end effector towards a goal, translation and rotation arriving together."""
    offset = goal.position - sight.end_effector.position
    turn = turn_between(sight.end_effector.rotation, goal.rotation)
    lead_m = min(pace.lead_m, pace.start_m + sight.speed * STEP_S / _FOLLOWING)
    lead_rad = min(pace.lead_rad, pace.start_rad + sight.spin * STEP_S / _FOLLOWING)
    steps = max(pace.gain * length(offset) / pace.lead_m, pace.gain * length(turn) / pace.lead_rad, 1.0)
    share = pace.gain / steps
    return Pose(
        sight.end_effector.position + shortened(share * offset, lead_m),
        turned(shortened(share * turn, lead_rad), sight.end_effector.rotation),
    )


def reach(sight: Sight, goal: Goal, gripper: float, pace: Pace, done: Test, phase: str) -> Skill:
    """Lead the end effector towards a goal that may move with what is seen, until ``done`` or patience ends."""
    tired = Patience()
    while not (done(sight) or tired(sight)):
        sight = yield Command(towards(sight, goal(sight), pace), gripper, phase)
    return sight


def descend(sight: Sight, grasp: Goal, clearance_m: float, pace: Pace, phase: str, play_m: float = _PLAY_M) -> Skill:
    """Come down on a grasp with the gripper open, until something stops the end effector: the better placed, the lower.

    The smaller ``play_m``, by which the end effector may stand aside without its fingers meeting the part, the
    steeper: fingers that have come down on a tight part go up again.
    """
    steepness = (_PLAY_M / play_m) ** 3

    def goal(sight: Sight) -> Pose:
        pose = grasp(sight)
        offset = pose.position - sight.end_effector.position
        aside = math.hypot(offset[0], offset[1])
        turn = length(turn_between(sight.end_effector.rotation, pose.rotation))
        return above(pose, min(clearance_m, steepness * max(0.0, aside - play_m) + 0.15 * max(0.0, turn - 0.05)))

    arrived, stall = near(grasp, play_m, math.radians(3)), Stall()
    return reach(sight, goal, OPEN, pace, lambda sight: arrived(sight) or stall(sight), phase)


def rise(sight: Sight, height_m: float, gripper: float, pace: Pace, phase: str) -> Skill:
    """Go straight up to a height of the robot base frame."""

    def goal(sight: Sight) -> Pose:
        # Beyond the height, so that the end effector does not slow down before it goes on to something else.
        return above(sight.end_effector, height_m + 0.03 - float(sight.end_effector.position[2]))

    return reach(sight, goal, gripper, pace, lambda sight: float(sight.end_effector.position[2]) > height_m, phase)


def grip(sight: Sight, gripper: float, done: Test, phase: str, patience: int = 12) -> Skill:
    """Open or close the gripper where the end effector is, until ``done`` or the fingers no longer move."""
    hold = sight.end_effector
    for waited in range(patience):
        width = sight.width
        sight = yield Command(hold, gripper, phase)
        if done(sight) or (waited >= 2 and abs(sight.width - width) < _STILL_FINGERS_M):
            break
    return sight


class Lasting:
    """Test whether another test has held for some steps in a row."""

    def __init__(self, test: Test, steps: int) -> None:
        """Ask for so many steps."""
        self._test = test
        self._steps = steps
        self._held = 0

    def __call__(self, sight: Sight) -> bool:
        """Look once a step."""
        self._held = self._held + 1 if self._test(sight) else 0
        return self._held >= self._steps


class Stall(Lasting):
    """Test whether the end effector has stood still for some steps: whatever it pushes will not give."""

    def __init__(self, patience: int = 6) -> None:
        """Ask for ``patience`` steps in a row."""
        super().__init__(lambda sight: sight.speed < _STILL_M_S and sight.spin < _STILL_RAD_S, patience)


class Patience:
    """Test whether a skill has run for too long, and is better begun anew."""

    def __init__(self, steps: int = 150) -> None:
        """Wait for so many steps."""
        self._left = steps

    def __call__(self, sight: Sight) -> bool:
        """Look once a step."""
        self._left -= 1
        return self._left < 0


def near(goal: Goal, tolerance_m: float, tolerance_rad: float) -> Test:
    """Test whether the end effector has come to a goal."""

    def test(sight: Sight) -> bool:
        pose = goal(sight)
        return (
            length(pose.position - sight.end_effector.position) < tolerance_m
            and length(turn_between(sight.end_effector.rotation, pose.rotation)) < tolerance_rad
        )

    return test


def holding(sight: Sight, part: Pose, goal: Pose) -> Pose:
    """Goal of an end effector that holds a part which shall come to a goal."""
    return goal @ part.inverse() @ sight.end_effector


def above(pose: Pose, distance: float, direction: Vector = UP) -> Pose:
    """A pose moved along a direction, upwards if none is given."""
    return Pose(pose.position + distance * direction, pose.rotation)
