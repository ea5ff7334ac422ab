"""The header of an operator log: who did what from which initial state, as JSON text."""

from __future__ import annotations

import json
import operator
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, NoReturn

import numpy as np

from juicer.episode import ID_DIGITS
from juicer.errors import RejectedLog
from juicer.text import LONGEST_SHOWN, printable

FORMAT = "juicer-operator-log"
VERSION = 1

MOST_HEADER_LETTERS = 65_536
"""Longest JSON text of a header."""

_MOST_DIGITS = 18
_MISSING = object()
_OPTIONAL = ("operator", "recorded_at", "parent", "parent_step")
_TYPES: Mapping[str, type | tuple[type, ...]] = {
    "task": str,
    "randomness": str,
    "seed": int,
    "device": str,
    "success": bool,
    "outcome": (str, type(None)),
    "parts_assembled": int,
    "milestones": dict,
    "operator": (str, type(None)),
    "recorded_at": (str, type(None)),
    "parent": (str, type(None)),
    "parent_step": (int, type(None)),
}
_ID = re.compile(rf"[0-9a-f]{{{ID_DIGITS}}}")


@dataclass(frozen=True, kw_only=True)
class LogHeader:
    """What a log says about itself.

    Attributes:
        task: Assembly task, e.g. ``one_leg``.
        randomness: Level of the initial state.
        seed: Initial-state seed that ``reset`` was given.
        device: What the operator held.
        success: The operator's mark: keep this demonstration.
        outcome: How the environment ended it; None if the operator stopped before.
        parts_assembled: Number of pairs assembled at its end.
        milestones: Number of steps after which each milestone was reached first, by name.
        operator: Who that was, if the log is to say it.
        recorded_at: When, e.g. ``2026-11-26T14:03:00+01:00``, if the log is to say it.
        parent: Id of the rollout that it corrects; None if it goes from the reset to its seed.
        parent_step: Step of that rollout from which it goes.
    """

    task: str
    randomness: str
    seed: int
    device: str
    success: bool
    outcome: str | None
    parts_assembled: int
    milestones: Mapping[str, int] = field(default_factory=dict)
    operator: str | None = None
    recorded_at: str | None = None
    parent: str | None = None
    parent_step: int | None = None

    @property
    def first_step(self) -> int:
        """Steps that were made from the reset to its beginning."""
        return self.parent_step or 0

    def to_text(self) -> str:
        """JSON text; equal headers give equal text.

        Raises:
            RejectedLog: If an entry is of another type than it must be, or a text could not be shown.
        """
        entries = {entry.name: _plain(getattr(self, entry.name)) for entry in fields(LogHeader)}
        _check(entries)
        for name, value in (*entries.items(), *(("milestones", name) for name in entries["milestones"])):
            if isinstance(value, str) and printable(value) != value:
                raise RejectedLog(
                    f"header entry '{name}' must be at most {LONGEST_SHOWN} printable letters, got {printable(value)}"
                )
        told = {name: value for name, value in entries.items() if value is not None or name not in _OPTIONAL}
        text = json.dumps({"format": FORMAT, "version": VERSION, **told}, sort_keys=True)
        if len(text) > MOST_HEADER_LETTERS:
            raise RejectedLog(f"the header has {len(text):,} letters; it may have {MOST_HEADER_LETTERS:,}")
        return text


def parse_header(text: str) -> LogHeader:
    """Read a header back; its texts come out cut and escaped, fit to be shown and stored.

    Raises:
        RejectedLog: If it is no such text, of another format or version, or an entry is missing or of another type.
    """
    try:
        content = json.loads(
            text, parse_constant=_refuse_constant, parse_int=_parse_int, object_pairs_hook=_refuse_repetition
        )
    except RecursionError:
        raise RejectedLog("the header is nested too deeply") from None
    except ValueError as error:
        raise RejectedLog(f"the file is truncated or no operator log (header: {printable(error)})") from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise RejectedLog(f"the header does not say format '{FORMAT}'")
    version = content.get("version")
    if version != VERSION or isinstance(version, bool):
        raise RejectedLog(f"it has format version {printable(version, 20)}, but this program reads version {VERSION}")
    entries = {name: content.get(name, None if name in _OPTIONAL else _MISSING) for name in _TYPES}
    _check(entries)
    entries |= {name: printable(value) for name, value in entries.items() if isinstance(value, str)}
    entries["milestones"] = {printable(name): step for name, step in entries["milestones"].items()}
    return LogHeader(**entries)


def _check(entries: Mapping[str, Any]) -> None:
    for name, kind in _TYPES.items():
        value = entries[name]
        # To Python true and false are integers.
        if not isinstance(value, kind) or (kind is not bool and isinstance(value, bool)):
            raise RejectedLog(f"header entry '{name}' is missing or of the wrong type")
        if isinstance(value, int) and not -(10**_MOST_DIGITS) < value < 10**_MOST_DIGITS:
            raise RejectedLog(f"header entry '{name}' is too large a number")
    _check_parent(entries["parent"], entries["parent_step"])
    for name, step in entries["milestones"].items():
        if not isinstance(name, str):
            raise RejectedLog(f"the name of a milestone must be a text, got {printable(repr(name))}")
        if not isinstance(step, int) or isinstance(step, bool) or not 0 <= step < 10**_MOST_DIGITS:
            raise RejectedLog(
                f"milestone '{printable(name)}' must be the number of a step, got {printable(repr(step))}"
            )


def _check_parent(parent: str | None, step: int | None) -> None:
    if (parent is None) != (step is None):
        raise RejectedLog("the header must say both 'parent' and 'parent_step', or neither")
    if parent is not None and not _ID.fullmatch(parent):
        raise RejectedLog(f"header entry 'parent' must be the id of an episode, got {printable(parent)}")
    if step is not None and step < 0:
        raise RejectedLog(f"header entry 'parent_step' must be the number of a step, got {step}")


def _plain(value: Any) -> Any:
    """Numbers as an environment or numpy gives them, as JSON says them."""
    if isinstance(value, np.bool_):
        return bool(value)
    if isinstance(value, np.integer):
        return operator.index(value)
    if isinstance(value, str):
        return str(value)
    return {_plain(key): _plain(item) for key, item in value.items()} if isinstance(value, Mapping) else value


def _refuse_constant(name: str) -> NoReturn:
    raise RejectedLog(f"the header holds {name}, which is not a number")


def _parse_int(digits: str) -> int:
    if len(digits) > _MOST_DIGITS:
        raise RejectedLog(f"the header holds a number of {len(digits):,} digits")
    return int(digits)


def _refuse_repetition(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content: dict[str, Any] = {}
    for key, value in pairs:
        if key in content:
            raise RejectedLog(f"the header says '{printable(key)}' twice")
        content[key] = value
    return content
