"""What a session says of itself at a moment."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from juicer.teleoperation.verification import Verification


class Phase(StrEnum):
    """What becomes of the present moment."""

    RECORDING = "recording"
    """The operator acts: the steps become part of the demonstration."""
    IDLE = "idle"
    """The operator does nothing: steps, if there are any, are marked and left out later."""
    PAUSED = "paused"
    """Recording has stopped: by the operator, or because nothing is heard of them."""
    OVER = "over"
    """The episode has ended: it is being saved, or waits for what the operator decides."""


@dataclass(frozen=True)
class Kept:
    """What became of an episode that was saved.

    Attributes:
        name: Name of its log.
        verification: What is known of that.
    """

    name: str
    verification: Verification


@dataclass(frozen=True)
class Status:
    """Everything about a session that is no image.

    Attributes:
        phase: What becomes of the present moment.
        sentence: The same for people, with what they may do about it.
        task: Assembly task.
        randomness: Level of the initial states.
        operator: Name of the operator.
        keys: Name of the key map.
        target: Demonstrations wanted.
        time_scale: Simulated seconds a second.
        undo_s: Seconds that the longer undo takes back.
        seed: Initial-state seed of the episode in hand.
        origin: Where it begins, in words.
        step: Steps recorded, idle ones too.
        acted: Those of them in which the operator acted.
        assembled: Pairs that are assembled.
        pairs: Pairs of the task.
        gripper_closes: Whether the gripper was told to close.
        slow: Whether slow mode is on.
        demonstrations: Good ones in the folder, those of earlier sessions too; corrections do not count.
        corrections: Good ones in the folder, likewise.
        checking: Logs in the folder whose check has not come to an end; they do not count yet.
        kept: What became of the last episodes in the folder, newest first.
        folder: Where the logs are.
    """

    phase: Phase
    sentence: str
    task: str
    randomness: str
    operator: str
    keys: str
    target: int
    time_scale: float
    undo_s: float
    seed: int
    origin: str
    step: int
    acted: int
    assembled: int
    pairs: int
    gripper_closes: bool
    slow: bool
    demonstrations: int
    corrections: int
    checking: int
    kept: tuple[Kept, ...]
    folder: str


@dataclass(frozen=True)
class Snapshot:
    """What there is to be drawn and said at a moment.

    Attributes:
        number: Counts moments; the newest has the largest.
        at_s: When that was, by the monotonic clock.
        heard: Sequence number of the last message of the controller by then.
        moved_by: That of the message that the last step of the simulator obeyed.
        task: Whose scene it is.
        qpos: Joint positions to be drawn ``(nq,)``.
        end_effector: Position of the end effector ``(3,)`` in the robot base frame [m].
        observation: What a policy that sees states would be shown.
        status: All that is said.
    """

    number: int
    at_s: float
    heard: int
    moved_by: int
    task: str
    qpos: NDArray[np.float64]
    end_effector: NDArray[np.float32]
    status: Status
    observation: dict[str, NDArray[np.float32]] = field(default_factory=dict)

    def numbers(self) -> dict[str, Any]:
        """The observation as numbers, for whoever reads rather than looks."""
        return {name: np.round(values.astype(np.float64), 6).tolist() for name, values in self.observation.items()}
