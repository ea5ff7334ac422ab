"""How an operator builds one_leg: push the top into the corner, stand the leg up, insert it, screw it in.

After every skill the scene decides what comes next, so that whatever went wrong (a grasp that missed, a leg that
fell) is simply done again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from juicer.tasks.specification import TABLE_HEIGHT_M, AssemblyTask
from juicer.teleoperation.gripper_room import Block, has_room, nearest_room, obstacles
from juicer.teleoperation.one_leg_view import (
    HOME_XY,
    LEG_HALF_SIZE_M,
    TOP_HALF_WIDTH_M,
    WALL_M,
    OneLegView,
    downward,
)
from juicer.teleoperation.pose import UP, Pose, Vector, cross, length, turned
from juicer.teleoperation.scene import Scene
from juicer.teleoperation.skills import (
    CLOSE,
    OPEN,
    Command,
    Pace,
    Skill,
    Stall,
    above,
    descend,
    grip,
    holding,
    near,
    reach,
    rise,
    towards,
)

_PUSH_BEYOND_M = 0.002
_PUSH_LEAD_M = 0.015
_INSERT_LEAD_M, _STROKE_LEAD_M = 0.010, 0.006
_STROKE_SINK_M = 0.005

# Heights of the leg above its seat: the peg's tip is over the rim, over the hole's mouth, inside it, on the beads.
_OVER_TOP_M, _OVER_HOLE_M, _IN_MOUTH_M, _ON_BEADS_M = 0.061, 0.031, 0.024, 0.018
_SINK_M = 0.020
_ALIGNED_M = 0.0025
_CAUGHT_M = 0.007
_UPRIGHT_RAD = math.radians(12)
_CLEAR_OF_LEG_M = 0.06
_FINGER_PLAY_M = 0.008


@dataclass(frozen=True)
class OneLegHabits:
    """What an operator does in an own way, all along a demonstration.

    Attributes:
        pace: How boldly the operator moves.
        clearance_m: Height at which the hand travels above what it will grasp.
        rim_height_m: Height above the table at which the top's rim is grasped.
        rim_offset_m: Distance of that grasp from the middle of the rim.
        leg_tilt_rad: Tilt of the hand that picks up the lying leg.
        leg_grasp_m: Distance of that grasp from the leg's origin, away from the peg.
        leg_grasp_height_m: Height of that grasp above the leg's axis.
        lift_m: Height of the hand at which the leg begins to be turned upright.
        via: Where the hand stands the leg upright.
        screw_grasp_m: Height above the leg's origin at which it is grasped for a stroke.
    """

    pace: Pace
    clearance_m: float
    rim_height_m: float
    rim_offset_m: float
    leg_tilt_rad: float
    leg_grasp_m: float
    leg_grasp_height_m: float
    lift_m: float
    via: tuple[float, float, float]
    screw_grasp_m: float

    @classmethod
    def draw(cls, rng: np.random.Generator) -> OneLegHabits:
        """Habits for one demonstration."""
        return cls(
            pace=Pace(lead_m=rng.uniform(0.016, 0.022), lead_rad=rng.uniform(0.22, 0.32)),
            clearance_m=rng.uniform(0.055, 0.075),
            rim_height_m=rng.uniform(0.020, 0.024),
            rim_offset_m=rng.uniform(-0.010, 0.010),
            leg_tilt_rad=math.radians(rng.uniform(46, 49)),
            leg_grasp_m=rng.uniform(0.009, 0.014),
            leg_grasp_height_m=rng.uniform(0.003, 0.006),
            lift_m=rng.uniform(0.055, 0.070),
            via=(rng.uniform(0.50, 0.55), rng.uniform(0.10, 0.14), rng.uniform(0.145, 0.165)),
            screw_grasp_m=rng.uniform(0.010, 0.014),
        )


class OneLegOperator:
    """The phases of one_leg as skills."""

    def __init__(self, task: AssemblyTask, habits: OneLegHabits) -> None:
        """Prepare to work on ``task``."""
        self._task = task
        self.view = OneLegView(task)
        self.habits = habits

    def work(self, scene: Scene) -> Skill:
        """Work for ever; whoever listens stops when the task is done."""
        while True:
            if self.view.is_engaged(scene):
                scene = yield from self.screw(scene)
            elif self.view.is_held(scene):
                scene = yield from self.insert(scene)
            elif self.view.is_home(scene, 0.008, math.radians(6)):
                scene = yield from self.pick_up(scene)
            else:
                scene = yield from self.push_home(scene)

    def push_home(self, scene: Scene) -> Skill:
        """Grasp the top's rim, push it into the corner and leave it."""
        view, habits = self.view, self.habits
        scene = yield from descend(scene, self._rim_grasp, habits.clearance_m, habits.pace, "go to the top")
        scene = yield from grip(scene, CLOSE, lambda scene: scene.width < WALL_M + 0.001, "grasp the top")
        stall = Stall()

        def pushed(scene: Scene) -> bool:
            return view.is_home(scene, 0.002, math.radians(1.5)) or stall(scene) or not self._holds_rim(scene)

        pace = habits.pace.at_most(_PUSH_LEAD_M)
        scene = yield from reach(scene, self._push_goal, CLOSE, pace, pushed, "push the top")
        return (yield from self._leave(scene, "leave the top"))

    def pick_up(self, scene: Scene) -> Skill:
        """Grasp the lying leg with a tilted hand, so that it can stand up without the hand in its way."""
        view, habits = self.view, self.habits
        tilt = habits.leg_tilt_rad
        if self._room_at_the_leg(scene, tilt) is None:
            scene = yield from self.pull_free(scene)
        aside = self._room_at_the_leg(scene, tilt) or 0.0

        def grasp(scene: Scene) -> Pose:
            return self._leg_grasp(scene, tilt, aside)

        scene = yield from descend(scene, grasp, habits.clearance_m, habits.pace, "go to the leg")
        scene = yield from grip(scene, CLOSE, view.is_closed_on_leg, "grasp the leg")
        if not view.is_held(scene):
            return (yield from self._leave(scene, "let go"))
        return scene

    def pull_free(self, scene: Scene) -> Skill:
        """Pull the lying leg out from among the other parts with an upright hand, which needs less room."""
        view, habits = self.view, self.habits
        leg = view.leg(scene)
        tilted = self._leg_grasp(scene, habits.leg_tilt_rad, 0.0)
        others = obstacles(self._task, scene, grasped=view.leg_index)
        shift = nearest_room(tilted, Block(leg, LEG_HALF_SIZE_M), others)
        if shift is None:
            return scene
        place = Pose(leg.position + shift, leg.rotation)
        aside = self._room_at_the_leg(scene, 0.0) or 0.0

        def grasp(scene: Scene) -> Pose:
            return self._leg_grasp(scene, 0.0, aside)

        def pull(scene: Scene) -> Pose:
            goal = holding(scene, view.leg(scene), place)
            return Pose(goal.position, scene.hand.rotation)

        def pulled(scene: Scene) -> bool:
            return length(place.position - view.leg(scene).position) < 0.005 or stall(scene) or not view.is_held(scene)

        scene = yield from descend(scene, grasp, habits.clearance_m, habits.pace, "go to the hemmed-in leg")
        scene = yield from grip(scene, CLOSE, view.is_closed_on_leg, "grasp the hemmed-in leg")
        stall = Stall()
        scene = yield from reach(scene, pull, CLOSE, habits.pace.at_most(_PUSH_LEAD_M), pulled, "pull the leg free")
        return (yield from self._leave(scene, "leave the leg"))

    def insert(self, scene: Scene) -> Skill:
        """Stand the held leg up, bring it over the hole and lower it until its thread meets the hole's."""
        view, pace = self.view, self.habits.pace

        def lifted(scene: Scene) -> bool:
            return float(scene.hand.position[2]) > self.habits.lift_m or not view.is_held(scene)

        def upright(scene: Scene) -> bool:
            return view.seat(scene).lean_rad < _UPRIGHT_RAD or not view.is_held(scene)

        if not upright(scene):
            scene = yield from reach(scene, lambda scene: above(scene.hand, 0.05), CLOSE, pace, lifted, "lift the leg")
            stall = Stall()
            scene = yield from reach(
                scene, self._standing, CLOSE, pace, lambda scene: upright(scene) or stall(scene), "stand the leg up"
            )
            if not upright(scene):
                return (yield from self._leave(scene, "let go"))
        while view.is_held(scene) and not self._rests_on_beads(scene):
            low = view.seat(scene).height_m < _OVER_HOLE_M + 0.005
            target = towards(scene, self._lowering(scene), pace.at_most(_INSERT_LEAD_M) if low else pace)
            scene = yield Command(target, CLOSE, "insert the leg" if low else "bring the leg over the hole")
        if view.is_engaged(scene):
            scene = yield from grip(scene, OPEN, view.is_open, "release the leg")
        return scene

    def screw(self, scene: Scene) -> Skill:
        """One stroke: turn the open hand back, grasp the leg, turn it clockwise, let go."""
        view, pace = self.view, self.habits.pace

        def flat_on_the_leg(scene: Scene) -> Pose:
            return Pose(self._screw_grasp(scene), downward(view.stroke_start(scene)))

        arrived = near(flat_on_the_leg, 0.004, math.radians(4))
        scene = yield from reach(
            scene,
            self._turning_back,
            OPEN,
            pace,
            lambda scene: arrived(scene) or not view.is_engaged(scene),
            "turn back",
        )
        if not view.is_engaged(scene):
            return scene
        scene = yield from grip(scene, CLOSE, view.is_closed_on_leg, "grasp for a stroke")
        stall = Stall()

        def turned_enough(scene: Scene) -> bool:
            return view.hand_yaw(scene) < view.stroke_end(scene) or stall(scene)

        scene = yield from reach(scene, self._stroke, CLOSE, pace.at_most(_STROKE_LEAD_M), turned_enough, "stroke")
        return (yield from grip(scene, OPEN, view.is_open, "release after a stroke"))

    def _leave(self, scene: Scene, phase: str) -> Skill:
        scene = yield from grip(scene, OPEN, self.view.is_open, phase)
        height = float(scene.hand.position[2]) + 0.05
        return (yield from rise(scene, height, OPEN, self.habits.pace, phase))

    def _rim_grasp(self, scene: Scene) -> Pose:
        """Hand over the wall nearest the robot, its fingers on both sides."""
        top = self.view.top(scene)
        rim = np.array([self.habits.rim_offset_m, 0.0, TOP_HALF_WIDTH_M - WALL_M / 2])
        position = top.position + top.rotation @ rim
        position[2] = TABLE_HEIGHT_M + self.habits.rim_height_m
        return Pose(position, downward(self.view.top_yaw(scene) + math.pi / 2))

    def _holds_rim(self, scene: Scene) -> bool:
        return WALL_M - 0.002 < scene.width < WALL_M + 0.003

    def _push_goal(self, scene: Scene) -> Pose:
        """Hand that has brought the held top slightly beyond its contact with the fence."""
        top = self.view.top(scene)
        home = np.array([HOME_XY[0] + _PUSH_BEYOND_M, HOME_XY[1] + _PUSH_BEYOND_M, top.position[2]])
        goal = holding(scene, top, Pose(home, turned(-self.view.top_yaw(scene) * UP, top.rotation)))
        position = np.array([goal.position[0], goal.position[1], TABLE_HEIGHT_M + self.habits.rim_height_m])
        return Pose(position, downward(math.atan2(goal.rotation[1, 0], goal.rotation[0, 0])))

    def _leg_grasp(self, scene: Scene, tilt_rad: float, aside_m: float) -> Pose:
        """Hand across the lying leg, tilted back towards its peg."""
        leg = self.view.leg(scene)
        axis = leg.rotation[:, 1]
        along = axis - axis[2] * UP
        along = along / max(length(along), 1e-6)
        c, s = math.cos(tilt_rad), math.sin(tilt_rad)
        x, z = c * along - s * UP, -c * UP - s * along
        y = cross(z, x)
        position = leg.position + self.habits.leg_grasp_m * axis + self.habits.leg_grasp_height_m * UP + aside_m * y
        return Pose(position, np.column_stack([x, y, z]))

    def _room_at_the_leg(self, scene: Scene, tilt_rad: float) -> float | None:
        """Smallest shift across the leg with which the hand keeps clear of the other parts; None if there is none."""
        others = obstacles(self._task, scene, grasped=self.view.leg_index)
        for aside in (0.0, _FINGER_PLAY_M, -_FINGER_PLAY_M):
            if has_room(self._leg_grasp(scene, tilt_rad, aside), others):
                return aside
        return None

    def _standing(self, scene: Scene) -> Pose:
        leg = self.view.leg(scene)
        return Pose(np.array(self.habits.via), self.view.upright(scene) @ leg.rotation.T @ scene.hand.rotation)

    def _lowering(self, scene: Scene) -> Pose:
        """Hand that holds the leg over its hole: the better aligned, the lower."""
        seat = self.view.seat(scene)
        # Wide high up and narrow at the hole's mouth, like a funnel; inside, the mouth itself leads the peg.
        tolerance = _ALIGNED_M + 0.25 * max(0.0, seat.height_m - _OVER_HOLE_M)
        if seat.height_m < _IN_MOUTH_M:
            tolerance = _CAUGHT_M
        error = seat.aside_m + 0.05 * seat.lean_rad
        sink = min(max(2.0 * (1.0 - error / tolerance), -1.0), 1.0)
        height = min(seat.height_m - _SINK_M * sink, _OVER_TOP_M)
        goal = Pose(self.view.seat_point(scene, height), self.view.upright(scene))
        return holding(scene, self.view.leg(scene), goal)

    def _rests_on_beads(self, scene: Scene) -> bool:
        return self.view.seat(scene).height_m < _ON_BEADS_M and float(scene.velocity[2]) > -0.006

    def _on_axis(self, scene: Scene) -> Vector:
        """Point of the hole's axis at the height of the leg's origin; the leg itself may lean."""
        point = self.view.seat_point(scene, 0.0)
        point[2] = self.view.leg(scene).position[2]
        return point

    def _screw_grasp(self, scene: Scene) -> Vector:
        return self._on_axis(scene) + self.habits.screw_grasp_m * UP

    def _turning_back(self, scene: Scene) -> Pose:
        """Way of the open hand to the next grasp: clear of a leg that leans, turn, come down."""
        view, hand = self.view, scene.hand
        grasp = Pose(self._screw_grasp(scene), downward(view.stroke_start(scene)))
        offset = hand.position - grasp.position
        if view.hand_tilt(scene) > math.radians(12):
            if length(offset) < _CLEAR_OF_LEG_M:
                return above(hand, -0.03, hand.rotation[:, 2])
            return above(grasp, _CLEAR_OF_LEG_M + 0.01)
        leans = view.seat(scene).lean_rad > math.radians(4)
        if leans and abs(view.stroke_start(scene) - view.hand_yaw(scene)) > math.radians(8):
            return above(hand, 0.03) if offset[2] < 0.045 else above(grasp, 0.055)
        return above(grasp, min(0.055, max(0.0, 1.5 * (math.hypot(offset[0], offset[1]) - 0.006))))

    def _stroke(self, scene: Scene) -> Pose:
        """Hand that turns clockwise over the hole's axis and never pulls the leg up."""
        position = self._on_axis(scene)
        position[2] = scene.hand.position[2] - _STROKE_SINK_M
        # Beyond the stroke's end, so that the hand does not slow down before it.
        return Pose(position, downward(self.view.stroke_end(scene) - math.radians(10)))
