"""How an operator mounts a part: pick it up, bring it over its seat, insert it, screw it in.

After every skill the scene decides what comes next, so that whatever went wrong (a grasp that missed, a part that
fell) is simply done again.
"""

from __future__ import annotations

import math

import numpy as np

from juicer.expert.corner import PUSH_LEAD_M, leave
from juicer.expert.gripper_room import REACHABLE, Block, clears_fence, nearest_room, obstacles
from juicer.expert.habits import Habits
from juicer.expert.laying import Laying
from juicer.expert.pair_view import STROKE_END_RAD, PairView, Seat, downward
from juicer.expert.picking import Picking, Shift
from juicer.expert.pose import UP, Matrix, Pose, Vector, length, turned
from juicer.expert.sight import Sight
from juicer.expert.skills import (
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
from juicer.tasks.specification import AssemblyTask

_INSERT_LEAD_M, _STROKE_LEAD_M = 0.010, 0.006
_STROKE_SINK_M = 0.005

# Heights of the part above its seat, beyond the depth of its hole: over its mouth, inside it.
_MOUTH_M, _INSIDE_M = 0.006, -0.001
# Below which a part rests: past the first turn of its thread, where it does not fall out again; on its seat.
_PAST_BEAD_M, _DOWN_M = 0.012, 0.004
_SINK_M = 0.020
_CAUGHT_M = 0.007
# Steps after which a part in its hole, which the end effector's tremor keeps from lying still, is taken for at rest.
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
# Height from which a part is dropped to be grasped anew.
_PUT_BACK_M = 0.07
_HIGHEST_M = 0.30

# Nearer to the robot than this, the wrist cannot bend as far: the end effector has to stand more upright over the hole.
_FAR_X_M, _TILT_RAD_M = 0.56, 6.5
# Steps in which the end effector is straightened until its palm clears the fence.
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
        self._picking = Picking(task, view, habits)
        self._laying = Laying(task, view, habits)
        self._habits = habits
        self._fumbles = view.part_index in habits.fumbles

    def step(self, sight: Sight) -> Skill:
        """Whatever comes next."""
        if self.view.is_held(sight):
            return (yield from self.insert(sight))
        return (yield from self.pick_up(sight))

    def is_begun(self, sight: Sight) -> bool:
        """Whether the part is on its way."""
        return self.view.is_held(sight)

    def pick_up(self, sight: Sight) -> Skill:
        """Grasp the part, one that lies with a tilted gripper, so that it can stand up without meeting the gripper."""
        view, habits = self.view, self._habits
        tilt = self._pick_tilt(sight)
        if self._is_cramped(sight, tilt):
            sight = yield from self.lay_free(sight)
            tilt = self._pick_tilt(sight)
        elif self._picking.room(sight, tilt) is None:
            sight = yield from self.pull_free(sight)
        shift = self._picking.room(sight, tilt) or Shift()

        def grasp(sight: Sight) -> Pose:
            pose = self._picking.grasp(view.part(sight), tilt, shift)
            short_m = view.clear_of_part(sight) + habits.fumble_m - float(pose.position[2]) if self._fumbles else 0.0
            return above(pose, max(0.0, short_m))

        def closed(sight: Sight) -> bool:
            return view.is_closed_on_part(sight) and not self._fumbles

        name = self.view.label
        play = self._handling.pick_play_m
        sight = yield from descend(sight, grasp, habits.clearance_m, habits.pace, f"go to the {name}", play)
        sight = yield from grip(sight, CLOSE, closed, f"grasp the {name}")
        if not view.is_held(sight):
            self._fumbles = False
            return (yield from self._leave(sight, "let go"))
        return sight

    def lay_free(self, sight: Sight) -> Skill:
        """Lay the part where a tilted gripper can pick it up."""
        place = self._laying.place(sight, lambda _: True)
        if place is None:
            return sight
        return (yield from self._laying.lay(sight, place, f"the hemmed-in {self.view.label}"))

    def pull_free(self, sight: Sight) -> Skill:
        """Pull the lying part out from among the other parts with an upright end effector, which needs less room."""
        view, habits = self.view, self._habits
        part = view.part(sight)
        tilted = self._picking.grasp(part, self._pick_tilt(sight), Shift())
        others = obstacles(self._task, sight, grasped=view.part_index)
        shift = nearest_room(tilted, Block(part, np.array(view.handling.half_size_m)), others)
        if shift is None:
            return sight
        place = Pose(part.position + shift, part.rotation)
        aside = self._picking.room(sight, 0.0) or Shift()

        def grasp(sight: Sight) -> Pose:
            return self._picking.grasp(view.part(sight), 0.0, aside)

        def pull(sight: Sight) -> Pose:
            goal = holding(sight, view.part(sight), place)
            return Pose(goal.position, sight.end_effector.rotation)

        def pulled(sight: Sight) -> bool:
            return length(place.position - view.part(sight).position) < 0.005 or stall(sight) or not view.is_held(sight)

        sight = yield from descend(
            sight, grasp, habits.clearance_m, habits.pace, f"go to the hemmed-in {self.view.label}"
        )
        sight = yield from grip(sight, CLOSE, view.is_closed_on_part, f"grasp the hemmed-in {self.view.label}")
        stall = Stall()
        sight = yield from reach(
            sight, pull, CLOSE, habits.pace.at_most(PUSH_LEAD_M), pulled, f"pull the {self.view.label} free"
        )
        return (yield from self._leave(sight, f"leave the {self.view.label}"))

    def insert(self, sight: Sight) -> Skill:
        """Stand the held part up, bring it over the hole and lower it until its thread meets the hole's."""
        view, pace, name = self.view, self._habits.pace, self.view.label

        def upright(sight: Sight) -> bool:
            return view.seat(sight).lean_rad < _UPRIGHT_RAD or not view.is_held(sight)

        def off_the_table(sight: Sight) -> bool:
            return float(sight.end_effector.position[2]) > self._habits.lift_m or not view.is_held(sight)

        def clear(sight: Sight) -> bool:
            return not self._is_low_and_away(sight) or not view.is_held(sight)

        def up(sight: Sight) -> Pose:
            return above(sight.end_effector, 0.05)

        if not upright(sight):
            sight = yield from reach(sight, up, CLOSE, pace, off_the_table, f"lift the {name}")
            stall = Stall()
            sight = yield from reach(
                sight,
                self._standing,
                CLOSE,
                pace,
                lambda sight: upright(sight) or stall(sight),
                f"stand the {name} up",
            )
            if not upright(sight):
                return (yield from self._leave(sight, "let go"))
        sight = yield from reach(sight, up, CLOSE, pace, clear, f"lift the {name}")
        tired, caught = Patience(), Lasting(view.is_engaged, _CAUGHT_STEPS)
        while view.is_held(sight) and not (caught(sight) or self._has_arrived(sight)):
            if tired(sight):
                return (yield from self.put_back(sight))
            low = view.seat(sight).height_m < view.depth_m + _MOUTH_M + 0.005
            target = towards(sight, self._lowering(sight), pace.at_most(_INSERT_LEAD_M) if low else pace)
            sight = yield Command(target, CLOSE, f"insert the {name}" if low else f"bring the {name} over its hole")
        return (yield from self._finish(sight))

    def put_back(self, sight: Sight) -> Skill:
        """Take a part that has turned in the grip back to where it came from, to grasp it anew."""
        phase, pace = f"take the {self.view.label} back", self._habits.pace
        x, y, _ = self._task.parts[self.view.part_index].start[:3]

        def place(sight: Sight) -> Pose:
            return Pose(np.array([x, y, _PUT_BACK_M]), sight.end_effector.rotation)

        def back(sight: Sight) -> bool:
            return arrived(sight) or stall(sight) or not self.view.is_held(sight)

        arrived, stall = near(place, 0.02, math.pi), Stall()
        over_the_seat = float(sight.end_effector.position[2]) + self.view.clear_m - self.view.seat(sight).height_m
        height = max(self._habits.via[2], min(over_the_seat, _HIGHEST_M))
        sight = yield from rise(sight, height, CLOSE, pace, phase)
        sight = yield from reach(sight, place, CLOSE, pace, back, phase)
        return (yield from self._leave(sight, phase))

    def _is_low_and_away(self, sight: Sight) -> bool:
        """Whether a part has yet to be lifted over what may be in its way."""
        seat = self.view.seat(sight)
        return seat.aside_m > _AWAY_M and seat.height_m < self.view.clear_m - 0.026

    def _leave(self, sight: Sight, phase: str) -> Skill:
        return (yield from leave(sight, self.view.open_width_m, self._habits, phase))

    def _is_cramped(self, sight: Sight, tilt_rad: float) -> bool:
        """Whether not even an upright gripper has room at the usual grasp, or the fence forbids to tilt it far off."""
        if not self._handling.lies or not self._laying.can_be_grasped(sight):
            return False
        x, y, _ = self.view.part(sight).position
        far_off = not ((REACHABLE[0] <= (x, y)).all() and ((x, y) <= REACHABLE[1]).all())
        if far_off and tilt_rad < self._full_tilt(sight):
            return True
        return self._picking.room(sight, tilt_rad) is None and self._picking.room(sight, 0.0) is None

    def _full_tilt(self, sight: Sight) -> float:
        nearer_m = max(0.0, _FAR_X_M - float(self.view.seat_pose(sight).position[0]))
        return self._habits.tilt_rad + _TILT_RAD_M * nearer_m

    def _pick_tilt(self, sight: Sight) -> float:
        """Tilt of the gripper that picks up the part; what it is short of upright, it will be tilted over the hole."""
        if not self._handling.lies:
            return 0.0
        tilt = self._full_tilt(sight)
        while tilt > 0 and not clears_fence(self._picking.grasp(self.view.part(sight), tilt, Shift())):
            tilt -= _LESS_TILT_RAD
        return tilt

    def _standing(self, sight: Sight) -> Pose:
        part = self.view.part(sight)
        return Pose(
            np.array(self._habits.via), self.view.upright(sight) @ part.rotation.T @ sight.end_effector.rotation
        )

    def _lowering(self, sight: Sight) -> Pose:
        """End effector that holds the part over its hole: the better aligned, the lower."""
        seat = self.view.seat(sight)
        # Wide high up and narrow at the hole's mouth, like a funnel; inside, the mouth itself leads the peg.
        tolerance = self._handling.aligned_m + 0.25 * max(0.0, seat.height_m - self.view.depth_m - _MOUTH_M)
        if self._is_in_hole(seat):
            tolerance = _CAUGHT_M
        error = (seat.aside_m + 0.05 * seat.lean_rad) / tolerance
        # An end effector that rises for every millimetre, or waits where it hardly moves, teaches policies to hover.
        if error > _ASTRAY:
            sink = -1.0
        elif error > _ASIDE:
            sink = 0.0
        else:
            sink = min(max(2.0 * (1.0 - error), _CREEP), 1.0)
        height = min(seat.height_m - _SINK_M * sink, self.view.clear_m)
        goal = Pose(self.view.seat_point(sight, height), self._entering(sight, seat))
        return holding(sight, self.view.part(sight), goal)

    def _is_in_hole(self, seat: Seat) -> bool:
        """Whether the part has come through the mouth of its hole."""
        return seat.height_m < self.view.depth_m + _INSIDE_M

    def _entering(self, sight: Sight, seat: Seat) -> Matrix:
        """Rotation in which the part is lowered."""
        return self.view.upright(sight)

    def _has_arrived(self, sight: Sight) -> bool:
        """Whether the part stands on what it was lowered onto."""
        seat = self.view.seat(sight)
        return seat.aside_m < _AWAY_M and seat.height_m < self._rests_below_m and float(sight.velocity[2]) > -0.006

    def _finish(self, sight: Sight) -> Skill:
        """Let go of the part that was lowered."""
        return (yield from self._leave(sight, f"leave the {self.view.label}"))


class ScrewMounting(Mounting):
    """The phases in which a part with a thread is mounted; pressed past its first turn, it stays in its hole."""

    _rests_below_m = _PAST_BEAD_M

    def step(self, sight: Sight) -> Skill:
        """Whatever comes next."""
        if self.view.is_engaged(sight):
            return (yield from self.screw(sight))
        return (yield from super().step(sight))

    def is_begun(self, sight: Sight) -> bool:
        """Whether the part is on its way."""
        return super().is_begun(sight) or self.view.is_engaged(sight)

    def screw(self, sight: Sight) -> Skill:
        """One stroke: turn the open gripper back, grasp the part, turn it clockwise, let go."""
        view, pace = self.view, self._habits.pace

        def flat_on_the_part(sight: Sight) -> Pose:
            return Pose(self._screw_grasp(sight), downward(view.stroke_start(sight)))

        arrived = near(flat_on_the_part, 0.004, math.radians(4))
        sight = yield from reach(
            sight,
            self._turning_back,
            OPEN,
            pace,
            lambda sight: arrived(sight) or not view.is_engaged(sight),
            "turn back",
        )
        if not view.is_engaged(sight):
            return sight
        if not arrived(sight):
            return (
                yield from rise(
                    sight, float(sight.end_effector.position[2]) + _CLEAR_OF_PART_M, OPEN, pace, "turn back"
                )
            )
        sight = yield from grip(sight, CLOSE, view.is_closed_on_part, "grasp for a stroke")
        stall = Stall()

        def turned_enough(sight: Sight) -> bool:
            return view.is_tight(sight) or view.end_effector_yaw(sight) < STROKE_END_RAD or stall(sight)

        sight = yield from reach(sight, self._stroke, CLOSE, pace.at_most(_STROKE_LEAD_M), turned_enough, "stroke")
        return (yield from grip(sight, OPEN, view.is_open, "release after a stroke"))

    def _finish(self, sight: Sight) -> Skill:
        """Let go of the part: in its hole, or where it came to rest instead."""
        if self.view.is_engaged(sight):
            sight = yield from grip(sight, OPEN, self.view.is_open, f"release the {self.view.label}")
        elif self.view.is_held(sight):
            sight = yield from self._leave(sight, "let go")
        return sight

    def _entering(self, sight: Sight, seat: Seat) -> Matrix:
        """Upright, but rocked away from the robot at the first turn of its thread, on which it would stand."""
        upright = self.view.upright(sight)
        at_first_turn = self._is_in_hole(seat) and seat.height_m > _PAST_BEAD_M
        return turned(_ROCK_RAD * _SIDEWAYS, upright) if at_first_turn else upright

    def _on_axis(self, sight: Sight) -> Vector:
        """Point of the hole's axis at the height of the part's origin; the part itself may lean."""
        point = self.view.seat_point(sight, 0.0)
        point[2] = self.view.part(sight).position[2]
        return point

    def _screw_grasp(self, sight: Sight) -> Vector:
        """Where the gripper grasps for a stroke: over the hole, which straightens the part, unless it leans too far."""
        along = self._handling.screw_m + self._habits.screw_offset_m
        lean = self.view.seat(sight).lean_rad
        if lean > _LEANS_FAR_RAD or lean * along > _LEANS_FAR_M:
            part = self.view.part(sight)
            return part.position + along * part.rotation[:, 1]
        return self._on_axis(sight) + along * UP

    def _turning_back(self, sight: Sight) -> Pose:
        """Way of the open gripper to the next grasp: clear of a part that leans, turn, come down."""
        view, end_effector = self.view, sight.end_effector
        grasp = Pose(self._screw_grasp(sight), downward(view.stroke_start(sight)))
        offset = end_effector.position - grasp.position
        if view.hand_tilt(sight) > math.radians(12):
            if length(offset) < _CLEAR_OF_PART_M:
                return above(end_effector, -0.03, end_effector.rotation[:, 2])
            return above(grasp, _CLEAR_OF_PART_M + 0.01)
        apart = self._handling.turn_back_above_m
        if apart and abs(view.stroke_start(sight) - view.end_effector_yaw(sight)) > math.radians(8):
            return above(end_effector, 0.03) if offset[2] < apart else above(grasp, apart + 0.01)
        leans = view.seat(sight).lean_rad > math.radians(4)
        if leans and abs(view.stroke_start(sight) - view.end_effector_yaw(sight)) > math.radians(8):
            return above(end_effector, 0.03) if offset[2] < 0.045 else above(grasp, 0.055)
        # The less room there is beside the part, the steeper, lest the fingers come down on it and stay there.
        play = 1.5 * self._handling.pick_play_m
        steepness = 1.5 * (0.006 / play) ** 3
        return above(grasp, min(0.055, steepness * max(0.0, math.hypot(offset[0], offset[1]) - play)))

    def _stroke(self, sight: Sight) -> Pose:
        """End effector that turns clockwise over the hole's axis and never pulls the part up."""
        position = self._on_axis(sight)
        position[2] = sight.end_effector.position[2] - _STROKE_SINK_M
        # Beyond the stroke's end, so that the end effector does not slow down before it.
        return Pose(position, downward(STROKE_END_RAD - math.radians(10)))
