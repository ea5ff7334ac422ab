"""How an operator mounts a part: pick it up, bring it over its seat, insert it, screw it in.

After every skill the scene decides what comes next, so that whatever went wrong (a grasp that missed, a part that
fell) is simply done again.
"""

from __future__ import annotations

import math

import numpy as np

from juicer.tasks.specification import AssemblyTask
from juicer.teleoperation.corner import PUSH_LEAD_M, leave
from juicer.teleoperation.gripper_room import Block, clears_fence, has_room, nearest_room, obstacles
from juicer.teleoperation.handling import Habits
from juicer.teleoperation.pair_view import EASY_YAW_RAD, STROKE_END_RAD, PairView, Seat, downward
from juicer.teleoperation.pose import UP, Matrix, Pose, Vector, cross, heading, length, swing, turned, wrapped
from juicer.teleoperation.scene import Scene
from juicer.teleoperation.skills import (
    CLOSE,
    OPEN,
    Command,
    Lasting,
    Patience,
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

_INSERT_LEAD_M, _STROKE_LEAD_M = 0.010, 0.006
_STROKE_SINK_M = 0.005

# Heights of the part above its seat, beyond the depth of its hole: over its mouth, inside it.
_MOUTH_M, _INSIDE_M = 0.006, -0.001
# Below which a part rests: past the first turn of its thread, where it does not fall out again; on its seat.
_PAST_BEAD_M, _DOWN_M = 0.012, 0.004
_SINK_M = 0.020
_CAUGHT_M = 0.007
# Steps after which a part in its hole, which the hand's tremor keeps from lying still, is taken for at rest.
_CAUGHT_STEPS = 20
# Errors in tolerances from which the part only moves sideways, and from which it is lifted as well.
_ASIDE, _ASTRAY = 2.0, 4.0
# Sink of a part that is not aligned yet, of that of one that is.
_CREEP = 0.15
_UPRIGHT_RAD, _LEANS_FAR_RAD, _LEANS_FAR_M = math.radians(12), math.radians(12), 0.005
# Away from the robot, about the y axis of its base.
_ROCK_RAD, _SIDEWAYS = math.radians(6), np.array([0.0, 1.0, 0.0])
_CLEAR_OF_PART_M = 0.06
_AWAY_M = 0.05
_FINGER_PLAY_M = 0.008
# Height from which a part is dropped to be grasped anew.
_PUT_BACK_M = 0.07
_HIGHEST_M = 0.30

# Nearer to the robot than this, the wrist cannot bend as far: the hand has to stand more upright over the hole.
_FAR_X_M, _TILT_RAD_M = 0.56, 6.5
# Steps in which the hand is straightened until its palm clears the fence.
_LESS_TILT_RAD = math.radians(2)


class Mounting:
    """The phases in which a part is mounted."""

    _rests_below_m = _DOWN_M
    """Height above its seat below which a part that no longer sinks rests on what it was lowered onto."""

    def __init__(self, task: AssemblyTask, view: PairView, habits: Habits) -> None:
        """Prepare to mount the part of ``view``."""
        self._task = task
        self.view = view
        self._handling = view.handling
        self._habits = habits
        self._fumbles = view.part_index in habits.fumbles

    def step(self, scene: Scene) -> Skill:
        """Whatever comes next."""
        if self.view.is_held(scene):
            return (yield from self.insert(scene))
        return (yield from self.pick_up(scene))

    def is_begun(self, scene: Scene) -> bool:
        """Whether the part is on its way."""
        return self.view.is_held(scene)

    def pick_up(self, scene: Scene) -> Skill:
        """Grasp the part, one that lies with a tilted hand, so that it can stand up without the hand in its way."""
        view, habits = self.view, self._habits
        tilt = self._pick_tilt(scene)
        if self._room(scene, tilt) is None:
            scene = yield from self.pull_free(scene)
        aside = self._room(scene, tilt) or 0.0

        def grasp(scene: Scene) -> Pose:
            pose = self._pick_grasp(scene, tilt, aside)
            short_m = view.clear_of_part(scene) + habits.fumble_m - float(pose.position[2]) if self._fumbles else 0.0
            return above(pose, max(0.0, short_m))

        def closed(scene: Scene) -> bool:
            return view.is_closed_on_part(scene) and not self._fumbles

        name = self.view.label
        play = self._handling.pick_play_m
        scene = yield from descend(scene, grasp, habits.clearance_m, habits.pace, f"go to the {name}", play)
        scene = yield from grip(scene, CLOSE, closed, f"grasp the {name}")
        if not view.is_held(scene):
            self._fumbles = False
            return (yield from self._leave(scene, "let go"))
        return scene

    def pull_free(self, scene: Scene) -> Skill:
        """Pull the lying part out from among the other parts with an upright hand, which needs less room."""
        view, habits = self.view, self._habits
        part = view.part(scene)
        tilted = self._pick_grasp(scene, self._pick_tilt(scene), 0.0)
        others = obstacles(self._task, scene, grasped=view.part_index)
        shift = nearest_room(tilted, Block(part, np.array(view.handling.half_size_m)), others)
        if shift is None:
            return scene
        place = Pose(part.position + shift, part.rotation)
        aside = self._room(scene, 0.0) or 0.0

        def grasp(scene: Scene) -> Pose:
            return self._pick_grasp(scene, 0.0, aside)

        def pull(scene: Scene) -> Pose:
            goal = holding(scene, view.part(scene), place)
            return Pose(goal.position, scene.hand.rotation)

        def pulled(scene: Scene) -> bool:
            return length(place.position - view.part(scene).position) < 0.005 or stall(scene) or not view.is_held(scene)

        scene = yield from descend(
            scene, grasp, habits.clearance_m, habits.pace, f"go to the hemmed-in {self.view.label}"
        )
        scene = yield from grip(scene, CLOSE, view.is_closed_on_part, f"grasp the hemmed-in {self.view.label}")
        stall = Stall()
        scene = yield from reach(
            scene, pull, CLOSE, habits.pace.at_most(PUSH_LEAD_M), pulled, f"pull the {self.view.label} free"
        )
        return (yield from self._leave(scene, f"leave the {self.view.label}"))

    def insert(self, scene: Scene) -> Skill:
        """Stand the held part up, bring it over the hole and lower it until its thread meets the hole's."""
        view, pace, name = self.view, self._habits.pace, self.view.label

        def upright(scene: Scene) -> bool:
            return view.seat(scene).lean_rad < _UPRIGHT_RAD or not view.is_held(scene)

        def off_the_table(scene: Scene) -> bool:
            return float(scene.hand.position[2]) > self._habits.lift_m or not view.is_held(scene)

        def clear(scene: Scene) -> bool:
            return not self._is_low_and_away(scene) or not view.is_held(scene)

        def up(scene: Scene) -> Pose:
            return above(scene.hand, 0.05)

        if not upright(scene):
            scene = yield from reach(scene, up, CLOSE, pace, off_the_table, f"lift the {name}")
            stall = Stall()
            scene = yield from reach(
                scene,
                self._standing,
                CLOSE,
                pace,
                lambda scene: upright(scene) or stall(scene),
                f"stand the {name} up",
            )
            if not upright(scene):
                return (yield from self._leave(scene, "let go"))
        scene = yield from reach(scene, up, CLOSE, pace, clear, f"lift the {name}")
        tired, caught = Patience(), Lasting(view.is_engaged, _CAUGHT_STEPS)
        while view.is_held(scene) and not (caught(scene) or self._has_arrived(scene)):
            if tired(scene):
                return (yield from self.put_back(scene))
            low = view.seat(scene).height_m < view.depth_m + _MOUTH_M + 0.005
            target = towards(scene, self._lowering(scene), pace.at_most(_INSERT_LEAD_M) if low else pace)
            scene = yield Command(target, CLOSE, f"insert the {name}" if low else f"bring the {name} over its hole")
        return (yield from self._finish(scene))

    def put_back(self, scene: Scene) -> Skill:
        """Take a part that has turned in the grip back to where it came from, to grasp it anew."""
        phase, pace = f"take the {self.view.label} back", self._habits.pace
        x, y, _ = self._task.parts[self.view.part_index].start[:3]

        def place(scene: Scene) -> Pose:
            return Pose(np.array([x, y, _PUT_BACK_M]), scene.hand.rotation)

        def back(scene: Scene) -> bool:
            return arrived(scene) or stall(scene) or not self.view.is_held(scene)

        arrived, stall = near(place, 0.02, math.pi), Stall()
        over_the_seat = float(scene.hand.position[2]) + self.view.clear_m - self.view.seat(scene).height_m
        height = max(self._habits.via[2], min(over_the_seat, _HIGHEST_M))
        scene = yield from rise(scene, height, CLOSE, pace, phase)
        scene = yield from reach(scene, place, CLOSE, pace, back, phase)
        return (yield from self._leave(scene, phase))

    def _is_low_and_away(self, scene: Scene) -> bool:
        """Whether a part has yet to be lifted over what may be in its way."""
        seat = self.view.seat(scene)
        return seat.aside_m > _AWAY_M and seat.height_m < self.view.clear_m - 0.026

    def _leave(self, scene: Scene, phase: str) -> Skill:
        return (yield from leave(scene, self.view.open_width_m, self._habits, phase))

    def _pick_tilt(self, scene: Scene) -> float:
        """Tilt of the hand that picks up the part; what it is short of upright, it will be tilted over the hole."""
        if not self._handling.lies:
            return 0.0
        nearer_m = max(0.0, _FAR_X_M - float(self.view.seat_pose(scene).position[0]))
        tilt = self._habits.tilt_rad + _TILT_RAD_M * nearer_m
        while tilt > 0 and not clears_fence(self._pick_grasp(scene, tilt, 0.0)):
            tilt -= _LESS_TILT_RAD
        return tilt

    def _pick_grasp(self, scene: Scene, tilt_rad: float, aside_m: float) -> Pose:
        """Hand over the part: across one that lies, tilted back towards its peg, else straight down on its flats."""
        part, handling = self.view.part(scene), self._handling
        axis = part.rotation[:, 1]
        if not handling.lies:
            flat = heading(part.rotation[:, 0]) + handling.flat_rad
            yaw = EASY_YAW_RAD + wrapped(flat - EASY_YAW_RAD, handling.flat_every_rad)
            # One that was knocked over leans on something: the hand leans with it.
            upwards = axis if axis[2] > 0 else -axis
            return Pose(part.position + handling.pick_m * axis, turned(swing(UP, upwards), downward(yaw)))
        along = axis - axis[2] * UP
        along = along / max(length(along), 1e-6)
        c, s = math.cos(tilt_rad), math.sin(tilt_rad)
        x, z = c * along - s * UP, -c * UP - s * along
        y = cross(z, x)
        height = self._habits.pick_height_m - handling.pick_below_m
        where = (handling.pick_m + self._habits.pick_offset_m) * axis + height * UP
        return Pose(part.position + where + aside_m * y, np.column_stack([x, y, z]))

    def _room(self, scene: Scene, tilt_rad: float) -> float | None:
        """Smallest shift across the part with which the hand keeps clear of the other parts; None if there is none."""
        others = obstacles(self._task, scene, grasped=self.view.part_index)
        for aside in (0.0, _FINGER_PLAY_M, -_FINGER_PLAY_M):
            if has_room(self._pick_grasp(scene, tilt_rad, aside), others):
                return aside
        return None

    def _standing(self, scene: Scene) -> Pose:
        part = self.view.part(scene)
        return Pose(np.array(self._habits.via), self.view.upright(scene) @ part.rotation.T @ scene.hand.rotation)

    def _lowering(self, scene: Scene) -> Pose:
        """Hand that holds the part over its hole: the better aligned, the lower."""
        seat = self.view.seat(scene)
        # Wide high up and narrow at the hole's mouth, like a funnel; inside, the mouth itself leads the peg.
        tolerance = self._handling.aligned_m + 0.25 * max(0.0, seat.height_m - self.view.depth_m - _MOUTH_M)
        if self._is_in_hole(seat):
            tolerance = _CAUGHT_M
        error = (seat.aside_m + 0.05 * seat.lean_rad) / tolerance
        # A hand that rises for every millimetre, or waits where it hardly moves, teaches policies to hover.
        if error > _ASTRAY:
            sink = -1.0
        elif error > _ASIDE:
            sink = 0.0
        else:
            sink = min(max(2.0 * (1.0 - error), _CREEP), 1.0)
        height = min(seat.height_m - _SINK_M * sink, self.view.clear_m)
        goal = Pose(self.view.seat_point(scene, height), self._entering(scene, seat))
        return holding(scene, self.view.part(scene), goal)

    def _is_in_hole(self, seat: Seat) -> bool:
        """Whether the part has come through the mouth of its hole."""
        return seat.height_m < self.view.depth_m + _INSIDE_M

    def _entering(self, scene: Scene, seat: Seat) -> Matrix:
        """Rotation in which the part is lowered."""
        return self.view.upright(scene)

    def _has_arrived(self, scene: Scene) -> bool:
        """Whether the part stands on what it was lowered onto."""
        seat = self.view.seat(scene)
        return seat.aside_m < _AWAY_M and seat.height_m < self._rests_below_m and float(scene.velocity[2]) > -0.006

    def _finish(self, scene: Scene) -> Skill:
        """Let go of the part that was lowered."""
        return (yield from self._leave(scene, f"leave the {self.view.label}"))


class ScrewMounting(Mounting):
    """The phases in which a part with a thread is mounted; pressed past its first turn, it stays in its hole."""

    _rests_below_m = _PAST_BEAD_M

    def step(self, scene: Scene) -> Skill:
        """Whatever comes next."""
        if self.view.is_engaged(scene):
            return (yield from self.screw(scene))
        return (yield from super().step(scene))

    def is_begun(self, scene: Scene) -> bool:
        """Whether the part is on its way."""
        return super().is_begun(scene) or self.view.is_engaged(scene)

    def screw(self, scene: Scene) -> Skill:
        """One stroke: turn the open hand back, grasp the part, turn it clockwise, let go."""
        view, pace = self.view, self._habits.pace

        def flat_on_the_part(scene: Scene) -> Pose:
            return Pose(self._screw_grasp(scene), downward(view.stroke_start(scene)))

        arrived = near(flat_on_the_part, 0.004, math.radians(4))
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
        if not arrived(scene):
            return (yield from rise(scene, float(scene.hand.position[2]) + _CLEAR_OF_PART_M, OPEN, pace, "turn back"))
        scene = yield from grip(scene, CLOSE, view.is_closed_on_part, "grasp for a stroke")
        stall = Stall()

        def turned_enough(scene: Scene) -> bool:
            return view.is_tight(scene) or view.hand_yaw(scene) < STROKE_END_RAD or stall(scene)

        scene = yield from reach(scene, self._stroke, CLOSE, pace.at_most(_STROKE_LEAD_M), turned_enough, "stroke")
        return (yield from grip(scene, OPEN, view.is_open, "release after a stroke"))

    def _finish(self, scene: Scene) -> Skill:
        """Let go of the part: in its hole, or where it came to rest instead."""
        if self.view.is_engaged(scene):
            scene = yield from grip(scene, OPEN, self.view.is_open, f"release the {self.view.label}")
        elif self.view.is_held(scene):
            scene = yield from self._leave(scene, "let go")
        return scene

    def _entering(self, scene: Scene, seat: Seat) -> Matrix:
        """Upright, but rocked away from the robot at the first turn of its thread, on which it would stand."""
        upright = self.view.upright(scene)
        at_first_turn = self._is_in_hole(seat) and seat.height_m > _PAST_BEAD_M
        return turned(_ROCK_RAD * _SIDEWAYS, upright) if at_first_turn else upright

    def _on_axis(self, scene: Scene) -> Vector:
        """Point of the hole's axis at the height of the part's origin; the part itself may lean."""
        point = self.view.seat_point(scene, 0.0)
        point[2] = self.view.part(scene).position[2]
        return point

    def _screw_grasp(self, scene: Scene) -> Vector:
        """Where the hand grasps for a stroke: over the hole, which straightens the part, unless it leans too far."""
        along = self._handling.screw_m + self._habits.screw_offset_m
        lean = self.view.seat(scene).lean_rad
        if lean > _LEANS_FAR_RAD or lean * along > _LEANS_FAR_M:
            part = self.view.part(scene)
            return part.position + along * part.rotation[:, 1]
        return self._on_axis(scene) + along * UP

    def _turning_back(self, scene: Scene) -> Pose:
        """Way of the open hand to the next grasp: clear of a part that leans, turn, come down."""
        view, hand = self.view, scene.hand
        grasp = Pose(self._screw_grasp(scene), downward(view.stroke_start(scene)))
        offset = hand.position - grasp.position
        if view.hand_tilt(scene) > math.radians(12):
            if length(offset) < _CLEAR_OF_PART_M:
                return above(hand, -0.03, hand.rotation[:, 2])
            return above(grasp, _CLEAR_OF_PART_M + 0.01)
        apart = self._handling.turn_back_above_m
        if apart and abs(view.stroke_start(scene) - view.hand_yaw(scene)) > math.radians(8):
            return above(hand, 0.03) if offset[2] < apart else above(grasp, apart + 0.01)
        leans = view.seat(scene).lean_rad > math.radians(4)
        if leans and abs(view.stroke_start(scene) - view.hand_yaw(scene)) > math.radians(8):
            return above(hand, 0.03) if offset[2] < 0.045 else above(grasp, 0.055)
        # The less room there is beside the part, the steeper, lest the fingers come down on it and stay there.
        play = 1.5 * self._handling.pick_play_m
        steepness = 1.5 * (0.006 / play) ** 3
        return above(grasp, min(0.055, steepness * max(0.0, math.hypot(offset[0], offset[1]) - play)))

    def _stroke(self, scene: Scene) -> Pose:
        """Hand that turns clockwise over the hole's axis and never pulls the part up."""
        position = self._on_axis(scene)
        position[2] = scene.hand.position[2] - _STROKE_SINK_M
        # Beyond the stroke's end, so that the hand does not slow down before it.
        return Pose(position, downward(STROKE_END_RAD - math.radians(10)))
