"""What an operator chooses before anything is recorded."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Choice:
    """What an operator has chosen to record.

    Attributes:
        task: Assembly task.
        randomness: Level of the initial states.
        operator: Name of the operator who begins, for the logs; may be empty.
        target: Demonstrations wanted.
        keys: Name of the key map, for the logs.
    """

    task: str
    randomness: str = "low"
    operator: str = ""
    target: int = 50
    keys: str = "original"
