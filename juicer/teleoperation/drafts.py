"""The episode in hand, on the disk while it is made: a process that is killed loses nothing of it.

A draft is a file of JSON lines. The first says from which state the episode goes, each further one tells of an action,
of actions that were taken back, or of somebody who drives from there on. That is enough, for the simulator computes the
same again: what a draft is resumed to is compared, step by step, with what it was. A line is with the operating system
as soon as it is made, so that only a power cut can lose the last few. Whoever makes a draft holds a lock on it, which
ends with the process.
"""

from __future__ import annotations

import fcntl
import json
import os
import secrets
import zlib
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from juicer.artifacts.writing import disk_refusal
from juicer.demonstration.log import MOST_STEPS
from juicer.episode import ACTION_SIZE
from juicer.errors import DraftNotWritten, UnusableDraft
from juicer.reading import read_bounded
from juicer.sim.env import AssemblyEnv
from juicer.teleoperation.drivers import Driver
from juicer.teleoperation.origin import Origin
from juicer.text import printable

SUFFIX = ".draft"
DRAFTS = "drafts"
"""Name, in the folder of a task's logs, of where its drafts lie."""
MOST_BYTES = 64 * 2**20
"""Largest draft that is read back; one of the longest log has a tenth of it, if little was taken back."""

_FORMAT = "juicer-episode-in-hand-1"


@dataclass(frozen=True, kw_only=True)
class Beginning:
    """From where an episode goes, and who makes it.

    Attributes:
        task: Assembly task.
        randomness: Level of the initial states.
        seed: Initial-state seed.
        began: When its first step was made, e.g. ``2026-11-26T14:03:00+01:00``.
        operator: Name of the operator; may be empty.
        keys: Name of the key map.
        parent: Id of the rollout that it corrects, if it does.
        parent_step: Step of that rollout from which it goes.
        parent_actions: What was done before that step ``(parent_step, 10)``.
    """

    task: str
    randomness: str
    seed: int
    began: str
    operator: str = ""
    keys: str = "original"
    parent: str | None = None
    parent_step: int | None = None
    parent_actions: list[list[float]] | None = None


@dataclass(frozen=True)
class DraftStep:
    """One step of a draft.

    Attributes:
        action: Action ``(10,)``.
        idle: Whether the operator commanded nothing.
        before: Checksum of the simulator state before it.
    """

    action: NDArray[np.float32]
    idle: bool
    before: int


class Draft:
    """A draft that this process writes; nothing is on the disk before the first step."""

    def __init__(self, folder: Path, beginning: Beginning, state: NDArray[np.float64]) -> None:
        """Prepare it.

        Args:
            folder: Where drafts lie; made with the first one.
            beginning: What is going to be recorded.
            state: Simulator state before the first step.
        """
        self._path = folder / f"{beginning.seed:08d}-{secrets.token_hex(4)}{SUFFIX}"
        self._descriptor: int | None = None
        self._waiting = bytearray()
        self._put({"format": _FORMAT, **asdict(beginning), "state": state.tolist()})

    @property
    def name(self) -> str:
        """Its name, which no other draft has."""
        return self._path.stem

    @classmethod
    def _continued(cls, path: Path, descriptor: int) -> Self:
        draft = cls.__new__(cls)
        draft._path, draft._descriptor, draft._waiting = path, descriptor, bytearray()
        return draft

    def add(self, action: NDArray[Any], *, idle: bool, before: NDArray[np.float64]) -> None:
        """Add a step.

        Args:
            action: What was done ``(10,)``.
            idle: Whether the operator commanded nothing.
            before: Simulator state before it.

        Raises:
            DraftNotWritten: If the disk refuses it. It is kept in memory, and written with the next one.
        """
        values = np.asarray(action, np.float32).tolist()
        self._put({"action": values, "idle": bool(idle), "before": checksum(before)})
        self._write()

    def add_driver(self, driver: Driver) -> None:
        """Somebody drives from now on, or otherwise; it is written with the next step."""
        self._put({"driver": asdict(driver)})

    def take_back(self, steps: int) -> None:
        """Take back the last steps.

        Raises:
            DraftNotWritten: As for :meth:`add`.
        """
        if steps:
            self._put({"take_back": steps})
            self._write()

    def close(self) -> None:
        """Leave it on the disk, for somebody to take it up."""
        if self._descriptor is not None:
            with suppress(DraftNotWritten):
                self._write()
            os.close(self._descriptor)
            self._descriptor = None

    def remove(self) -> None:
        """Remove it: what it holds is saved, or nobody wants it. What the disk does not let go is offered again."""
        if self._descriptor is not None:
            with suppress(OSError):
                self._path.unlink(missing_ok=True)
            self._waiting.clear()
        self.close()

    def _put(self, line: Mapping[str, Any]) -> None:
        self._waiting += json.dumps(line, separators=(",", ":")).encode() + b"\n"

    def _write(self) -> None:
        """Write what waits; on a disk that is full a part of it may go, and the rest goes behind it later."""
        try:
            if self._descriptor is None:
                self._path.parent.mkdir(parents=True, exist_ok=True)
                self._descriptor = _locked(self._path, os.O_CREAT | os.O_EXCL)
            while self._waiting:
                del self._waiting[: os.write(self._descriptor, self._waiting)]
        except OSError as error:
            raise _not_written(error, self._path) from None


@dataclass(frozen=True)
class LeftDraft:
    """A draft whose maker is gone.

    Attributes:
        path: Where it lies.
        beginning: From where it goes.
        state: Simulator state before the first step.
        steps: Its steps, without those that were taken back.
        drivers: Who drove, and how, in their order.
    """

    path: Path
    beginning: Beginning
    state: NDArray[np.float64]
    steps: tuple[DraftStep, ...]
    drivers: tuple[Driver, ...]
    _num_bytes: int

    @property
    def origin(self) -> Origin | None:
        """The step of a rollout from which it goes, if it goes from one."""
        begun = self.beginning
        if begun.parent is None or begun.parent_step is None:
            return None
        return Origin(begun.parent, begun.parent_step, begun.seed, self.state, _actions(begun))

    def resume(self, env: AssemblyEnv, act: Callable[[NDArray[np.float32], bool], None]) -> int:
        """Do its steps again, as long as the simulator computes the same; another version of it may not.

        Args:
            env: Environment in the state before the first step.
            act: Executes an action in it; the second argument says whether the operator was idle.

        Returns:
            How many steps were done.
        """
        for number, step in enumerate(self.steps):
            if checksum(env.get_state()) != step.before:
                return number
            act(step.action, step.idle)
        return len(self.steps)

    def take_up(self, resumed: int) -> Draft:
        """Go on writing it.

        Args:
            resumed: How many of its steps there are again; the others are taken back.

        Raises:
            UnusableDraft: If somebody else has taken it up.
            DraftNotWritten: If the disk refuses it.
        """
        try:
            descriptor = _locked(self.path, 0)
            try:
                os.ftruncate(descriptor, self._num_bytes)
            except OSError:
                os.close(descriptor)
                raise
        except (BlockingIOError, FileNotFoundError):
            raise UnusableDraft(f"draft '{printable(self.path)}' was taken up or removed by somebody else") from None
        except OSError as error:
            raise _not_written(error, self.path) from None
        draft = Draft._continued(self.path, descriptor)
        draft.take_back(len(self.steps) - resumed)
        return draft


def left_in(*folders: Path) -> list[Path]:
    """Drafts in some folders that nobody writes, also because the disk refuses it; the latest first."""
    times = {}
    for folder in folders:
        for path in folder.glob(f"[!.]*{SUFFIX}"):
            with suppress(FileNotFoundError):
                times[path] = path.stat().st_mtime
    return sorted(filter(_is_left, times), key=lambda path: times[path], reverse=True)


def remove_draft(path: Path) -> None:
    """Remove a draft that nobody wants, whether or not it can be read.

    Raises:
        UnusableDraft: If the disk refuses that.
    """
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        reason = disk_refusal(error, path.parent) or error.strerror
        raise UnusableDraft(f"draft '{printable(path)}' cannot be removed: {reason}") from None


def read_draft(path: Path) -> LeftDraft:
    """Read a draft back, as far as it was written, to go on with it.

    Raises:
        UnusableDraft: If it is not a draft, nothing was recorded yet, or the disk lets nobody write it.
    """
    where = f"draft '{printable(path)}'"
    if refusal := _refusal(path):
        raise UnusableDraft(
            f"nobody can go on with {where}, as it cannot be written ({refusal}); mount its disk for writing, or see "
            "to its permissions, and reload this page"
        )
    try:
        first, *lines = read_bounded(path, MOST_BYTES).splitlines(keepends=True)
        content = json.loads(first)
        if content.pop("format") != _FORMAT:
            raise UnusableDraft(f"{where} is of another version of juicer; remove it")
        state = np.array(content.pop("state"), np.float64)
        beginning = Beginning(**content)
        if beginning.parent is not None and beginning.parent_actions is None:
            raise UnusableDraft(
                f"{where} is a correction of an earlier version of juicer, which does not hold the actions of its "
                "rollout; remove it, and finish the rollout by hand again"
            )
        if _actions(beginning).shape != (beginning.parent_step or 0, ACTION_SIZE):
            raise ValueError
    except OSError as error:
        raise UnusableDraft(f"{where} cannot be read: {error.strerror or error}") from None
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        raise UnusableDraft(f"{where} is damaged from its first line on; remove it") from None
    steps, drivers, num_bytes = _told(lines)
    if not steps:
        raise UnusableDraft(f"{where} holds no steps; remove it")
    # Drafts of earlier versions do not tell who drives.
    drivers = drivers or [Driver(printable(beginning.operator), "keyboard", printable(beginning.keys), 1.0)]
    return LeftDraft(path, beginning, state, tuple(steps), tuple(drivers), len(first) + num_bytes)


def _not_written(error: OSError, path: Path) -> DraftNotWritten:
    return DraftNotWritten(error.errno, disk_refusal(error, path.parent) or error.strerror, str(path))


def checksum(state: NDArray[np.float64]) -> int:
    """A number that is another for another simulator state."""
    return zlib.crc32(state.tobytes())


def _actions(beginning: Beginning) -> NDArray[np.float32]:
    return np.array(beginning.parent_actions or [], np.float32).reshape(-1, ACTION_SIZE)


def _told(lines: Iterable[bytes]) -> tuple[list[DraftStep], list[Driver], int]:
    """Steps and drivers up to the first line that is not whole, and the bytes of these lines."""
    steps: list[DraftStep] = []
    drivers: list[Driver] = []
    num_bytes = 0
    for line in lines:
        try:
            content: Any = json.loads(line) if line.endswith(b"\n") else None
            if taken_back := int(content.get("take_back", 0)):
                del steps[max(len(steps) - taken_back, 0) :]
            elif "driver" in content:
                drivers.append(_driver(content["driver"]))
            elif len(steps) < MOST_STEPS:
                steps.append(_step(content))
        except (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError):
            break
        num_bytes += len(line)
    return steps, drivers, num_bytes


def _driver(content: Mapping[str, Any]) -> Driver:
    operator, source, keys = (printable(content[name]) for name in ("operator", "source", "keys"))
    return Driver(operator, source, keys, float(content["time_scale"]))


def _step(content: Mapping[str, Any]) -> DraftStep:
    action = np.array(content["action"], np.float32)
    if action.shape != (ACTION_SIZE,) or not np.isfinite(action).all():
        raise ValueError
    return DraftStep(action, bool(content["idle"]), int(content["before"]))


def _locked(path: Path, how: int) -> int:
    descriptor = os.open(path, os.O_RDWR | os.O_APPEND | os.O_CLOEXEC | how, 0o666)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        raise
    return descriptor


def _is_left(path: Path) -> bool:
    try:
        os.close(_locked(path, os.O_NONBLOCK))
    except OSError:
        return bool(_refusal(path))
    return True


def _refusal(path: Path) -> str:
    """Why the disk does not let a draft be written; empty if it does, or the draft is gone."""
    try:
        os.close(os.open(path, os.O_RDWR | os.O_CLOEXEC | os.O_NONBLOCK))
    except FileNotFoundError:
        return ""
    except OSError as error:
        return error.strerror or str(error)
    return ""
