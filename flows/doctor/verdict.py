"""What a check says."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import StrEnum

from flows.running.settings import Settings


class State(StrEnum):
    """How bad it is."""

    OK = "ok"
    WARNING = "warning"
    PROBLEM = "problem"


@dataclass(frozen=True)
class Verdict:
    """One line of the examination.

    Attributes:
        state: A problem keeps juicer from working; a warning makes it slower or less comfortable.
        message: What was found.
        remedy: What to do about it; empty if nothing is to be done.
    """

    state: State
    message: str
    remedy: str = ""


Check = Callable[[Settings], Iterator[Verdict]]
"""Looks at one thing; must leave the machine as it was, and may raise whatever it likes."""


def ok(message: str) -> Verdict:
    """Nothing to do."""
    return Verdict(State.OK, message)


def warning(message: str, remedy: str) -> Verdict:
    """Works, but not as well as it could."""
    return Verdict(State.WARNING, message, remedy)


def problem(message: str, remedy: str) -> Verdict:
    """Does not work."""
    return Verdict(State.PROBLEM, message, remedy)
