"""What a device shows, and what its operator means by it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from juicer.teleoperation.key_maps import Action

__all__ = ["Action", "ControllerState", "Intent", "Source"]

Source = Literal["keyboard", "gamepad", "spacemouse", "pose"]


@dataclass(frozen=True, kw_only=True)
class ControllerState:
    """All that a device shows at one moment: a state, not events, so that a lost or repeated one does no harm.

    Attributes:
        source: Kind of device.
        sequence: Number of the message, larger than that of every one before it.
        held: What is pressed now: ``KeyboardEvent.code``, or names of buttons.
        edges: How often each key or button was pressed since the connection began.
        axes: Of a gamepad: left stick x, y, right stick x, y, left and right trigger, each in -1..1.
        twist: Of a SpaceMouse: x to the right, y towards the operator, z down, and turns about these, in -1..1.
        pose_delta: Of a pose device: how far it has moved since its clutch was closed, in the robot base frame:
            ``(x, y, z)`` [m], then a rotation vector [rad].
        clutch: Of a pose device: whether the robot shall follow it.
    """

    source: Source
    sequence: int
    held: frozenset[str] = frozenset()
    edges: Mapping[str, int] = field(default_factory=dict)
    axes: tuple[float, ...] = ()
    twist: tuple[float, ...] | None = None
    pose_delta: tuple[float, ...] | None = None
    clutch: bool = False


@dataclass(frozen=True)
class Intent:
    """What the operator wants for the next control step.

    Attributes:
        twist: Velocity of the end effector in the robot base frame, rotation composed onto its present orientation:
            three [m/s], three [rad/s]; slow mode and limits are in it already.
        slow: Whether slow mode is on.
        presses: What was asked for, each once.
    """

    twist: tuple[float, float, float, float, float, float] = (0.0,) * 6
    slow: bool = False
    presses: frozenset[Action] = frozenset()

    @property
    def moves(self) -> bool:
        """Whether the end effector is to move."""
        return any(self.twist)
