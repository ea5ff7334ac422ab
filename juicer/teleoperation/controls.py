"""What a device shows, and what its operator means by it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from juicer.geometry import matrix_to_rotvec, rotvec_to_matrix
from juicer.sim.env import STEP_S
from juicer.teleoperation.key_maps import DEFAULT, Action, Bindings, KeyMap, Motion

__all__ = ["Action", "ControllerState", "Controls", "Device", "Intent"]

FASTEST_M_S = 0.25
"""Largest component of a velocity: the original's 2.5 cm a step."""
FASTEST_RAD_S = float(np.deg2rad(200.0))
"""Largest rotational velocity: the original's 20 degrees a step."""
GAMEPAD_DEAD_ZONE = 0.12
"""A stick that was let go rests up to a tenth away from its centre."""
SPACEMOUSE_DEAD_ZONE = 0.05
"""The original's."""

Vector = NDArray[np.float64]
Twist = tuple[float, float, float, float, float, float]
_NO_MOTION: Vector = np.zeros(6)
STILL: Twist = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


Device = Literal["keyboard", "gamepad", "spacemouse", "pose"]
"""What an operator holds."""

CLUTCH = "clutch"
"""Name under which a pose device counts how often its clutch was closed."""


@dataclass(frozen=True, kw_only=True)
class ControllerState:
    """All that an operator's devices show at one moment: a state, not events, so that losing one does no harm.

    Attributes:
        source: The device that is in use, for the record; what is held and moved counts whatever it says.
        sequence: Number of the message, larger than that of every one before it.
        held: What is pressed now: ``KeyboardEvent.code``, or names of buttons.
        edges: How often each key or button was pressed since the connection began.
        axes: Of a gamepad: left stick x, y, right stick x, y (right and down are positive), left and right trigger.
        twist: Of a SpaceMouse: x to the right, y towards the operator, z down, and turns about these, in -1..1.
        pose_delta: Of a pose device: how far it has moved since its clutch was closed, in the robot base frame:
            ``(x, y, z)`` [m], then a rotation vector [rad].
        clutch: Of a pose device: whether the robot shall follow it.
    """

    source: Device
    sequence: int
    held: frozenset[str] = frozenset()
    edges: Mapping[str, int] = field(default_factory=dict)
    axes: tuple[float, ...] = ()
    twist: tuple[float, ...] | None = None
    pose_delta: tuple[float, ...] | None = None
    clutch: bool = False

    def with_spacemouse(self, mouse: ControllerState) -> ControllerState:
        """This state of a page, together with that of a SpaceMouse that is plugged in where the simulator runs."""
        source = mouse.source if mouse.twist and any(mouse.twist) else self.source
        edges = {**self.edges, **mouse.edges}
        return replace(self, source=source, held=self.held | mouse.held, edges=edges, twist=mouse.twist)


@dataclass(frozen=True)
class Intent:
    """What the operator wants of the next control step.

    Attributes:
        twist: Velocity of the end effector in the robot base frame, three [m/s] and three [rad/s]; the rotation is
            composed onto its present orientation. Slow mode and limits are in it already.
        slow: Whether slow mode is on.
        presses: What was asked for, each once.
    """

    twist: Twist = STILL
    slow: bool = False
    presses: frozenset[Action] = frozenset()

    @property
    def moves(self) -> bool:
        """Whether the end effector is to move."""
        return any(self.twist)


class Controls:
    """Turns the states of one connection into intents.

    Attributes:
        key_map: What keys and buttons mean; may be replaced at any time.
    """

    def __init__(self, key_map: KeyMap = DEFAULT, seen: Mapping[str, int] = MappingProxyType({})) -> None:
        """Begin with a connection.

        Args:
            key_map: What keys and buttons mean.
            seen: Presses that were counted before, of a device that has been open for longer than the connection.
        """
        self.key_map = key_map
        self._seen = dict(seen)
        self._follower = _PoseFollower()

    def intent(self, state: ControllerState) -> Intent:
        """What is wanted of the next control step; to be asked for once a step.

        A key that was pressed several times since the last step is a press in each of as many steps.
        """
        slow = self._is_slow(state)
        speeds = self.key_map.speeds
        velocity = limited(self._of_keys(state) + self._of_gamepad(state) + self._of_spacemouse(state))
        share = speeds.slow if slow else 1.0
        velocity = limited(share * velocity + self._follower.velocity(state, share))
        x, y, z, roll, pitch, yaw = velocity.tolist()
        return Intent((x, y, z, roll, pitch, yaw), slow, self._presses(state))

    def release(self) -> None:
        """Forget what a pose device has yet to be followed in: nothing was heard of it, or it must stand still."""
        self._follower = _PoseFollower()

    def _presses(self, state: ControllerState) -> frozenset[Action]:
        pressed = set()
        for name, count in state.edges.items():
            meaning, seen = self.key_map.bindings.get(name), self._seen.get(name, 0)
            if not isinstance(meaning, Action):
                self._seen[name] = count
            elif count > seen:
                self._seen[name] = seen + 1
                pressed.add(meaning)
        return frozenset(pressed)

    def _is_slow(self, state: ControllerState) -> bool:
        bindings = self.key_map.bindings
        if self.key_map.speeds.slow_stays:
            return sum(count for name, count in state.edges.items() if bindings.get(name) is Motion.SLOW) % 2 == 1
        return any(bindings.get(name) is Motion.SLOW for name in state.held)

    def _of_keys(self, state: ControllerState) -> Vector:
        key_map, speeds = self.key_map, self.key_map.speeds
        return _held(state, key_map.keys, speeds.keyboard_m_s, speeds.keyboard_rad_s) + _held(
            state, key_map.buttons, speeds.gamepad_m_s, speeds.gamepad_rad_s
        )

    def _of_gamepad(self, state: ControllerState) -> Vector:
        if not state.axes:
            return np.zeros(6)
        left_x, left_y, right_x, right_y, left_trigger, right_trigger = state.axes
        right, near = responded(np.array([left_x, left_y]))
        lean_right, lean_near = responded(np.array([right_x, right_y]))
        (up,), (down,) = responded(np.array([right_trigger])), responded(np.array([left_trigger]))
        moves, turns = np.array([near, right, up - down]), np.array([-lean_right, lean_near, 0.0])
        speeds = self.key_map.speeds
        return np.concatenate([speeds.gamepad_m_s * moves, speeds.gamepad_rad_s * turns])

    def _of_spacemouse(self, state: ControllerState) -> Vector:
        if state.twist is None:
            return np.zeros(6)
        given = np.array(state.twist)
        x, y, z, about_x, about_y, about_z = np.where(np.abs(given) < SPACEMOUSE_DEAD_ZONE, 0.0, given)
        moves, turns = np.array([y, x, -z]), np.array([about_y, about_x, -about_z])
        speeds = self.key_map.speeds
        return np.concatenate([speeds.spacemouse_m_s * moves, speeds.spacemouse_rad_s * turns])


class _PoseFollower:
    """Lets the end effector follow a pose device as fast as it may; what is left is made up in later steps."""

    def __init__(self) -> None:
        self._closings: int | None = None
        self._last = self._left = _NO_MOTION

    def velocity(self, state: ControllerState, share: float) -> Vector:
        """Velocity of the next step, for which motions of the device count a share of what they are."""
        if not state.clutch or state.pose_delta is None:
            self._closings = None
            return _NO_MOTION
        now, closings = np.array(state.pose_delta), state.edges.get(CLUTCH, 0)
        if self._closings != closings:
            # Where the device is now is where the gripper is, even if it has moved since its clutch was closed.
            self._closings, self._last, self._left = closings, now, _NO_MOTION
        left = _composed(share * _between(self._last, now), self._left)
        velocity = limited(left / STEP_S)
        self._last, self._left = now, left - STEP_S * velocity  # the rest of a turn is about the same axis
        return velocity


def limited(velocity: Vector) -> Vector:
    """A velocity ``(6,)`` in its direction, but no faster than the original allows."""
    largest, turning = float(np.abs(velocity[:3]).max()), float(np.linalg.norm(velocity[3:]))
    scale = np.array([FASTEST_M_S / max(largest, FASTEST_M_S)] * 3 + [FASTEST_RAD_S / max(turning, FASTEST_RAD_S)] * 3)
    return scale * velocity


def responded(deflection: Vector) -> Vector:
    """What a stick ``(2,)`` or trigger ``(1,)`` means: nothing near its rest, full at its rim, and little in between.

    The zone without effect is round, and the response cubic, so that small motions are easy in every direction.
    """
    length = float(np.linalg.norm(deflection))
    beyond = min(max(length - GAMEPAD_DEAD_ZONE, 0.0) / (1 - GAMEPAD_DEAD_ZONE), 1.0)
    return deflection * (beyond**3 / length) if beyond else np.zeros_like(deflection)


def _held(state: ControllerState, bindings: Bindings, metres_s: float, radians_s: float) -> Vector:
    """Velocity ``(6,)`` while keys are held; two keys for one direction are as fast as one."""
    velocity = np.zeros(6)
    for motion in {bindings[name] for name in state.held if name in bindings}:
        if isinstance(motion, Motion) and motion is not Motion.SLOW:
            axis, sign = motion.component
            velocity[axis] += sign * (metres_s if axis < 3 else radians_s)
    return velocity


def _between(first: Vector, second: Vector) -> Vector:
    turn = rotvec_to_matrix(second[3:]) @ rotvec_to_matrix(first[3:]).T
    return np.concatenate([second[:3] - first[:3], matrix_to_rotvec(turn)])


def _composed(second: Vector, first: Vector) -> Vector:
    turn = rotvec_to_matrix(second[3:]) @ rotvec_to_matrix(first[3:])
    return np.concatenate([second[:3] + first[:3], matrix_to_rotvec(turn)])
