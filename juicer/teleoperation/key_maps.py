"""What keys and buttons mean."""

from __future__ import annotations

from enum import StrEnum


class Action(StrEnum):
    """What a press asks for, once."""

    GRIPPER = "gripper"
    UNDO = "undo"
    UNDO_MORE = "undo_more"
    SUCCESS = "success"
    DISCARD = "discard"
    PAUSE = "pause"
    PROCEED = "proceed"
    RESET = "reset"
