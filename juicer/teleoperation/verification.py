"""Whether a log that was written can be learned from: it is ingested for trial, and replayed from its first state.

This is done by a process of low priority, a new one for each log, so that nothing that happens to it reaches whoever
drives the robot. What comes of it is noted beside the log, so that it holds for later sessions, too.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from enum import StrEnum
from multiprocessing.connection import Connection
from pathlib import Path
from queue import LifoQueue

import numpy as np

from juicer.artifacts.contents import digest
from juicer.demonstration.ingestion import Ingestion, IngestionConfig
from juicer.demonstration.log import OperatorLog, read_log
from juicer.episode import STATE_KEY, Outcome
from juicer.errors import RejectedLog
from juicer.reading import read_bounded
from juicer.sim.env import AssemblyEnv
from juicer.text import printable

ATTEMPTS = 2
"""Processes that are given a log before it is left for ingestion to judge."""
NICENESS = 15
MOST_NOTE_BYTES = 4_096
"""Largest note of what became of a log."""
VERDICTS = "verified"
"""Name, beside the logs, of the folder of what their checks have come to."""
_SECONDS_TO_END = 5.0
_SECONDS_TO_RECOVER = 1.0


class Verdict(StrEnum):
    """How far the check of a log is."""

    CHECKING = "checking"
    """It waits for the process, or is being replayed."""
    VERIFIED = "verified"
    """It can be learned from, and replays bit for bit."""
    REJECTED = "rejected"
    """It cannot be learned from."""
    UNCHECKED = "unchecked"
    """The process died over it, or could not be started, again and again."""


@dataclass(frozen=True)
class Verification:
    """What is known of a log.

    Attributes:
        verdict: How far its check is.
        sentence: The same for people; why, if it was rejected.
    """

    verdict: Verdict
    sentence: str


Check = Callable[[Path, str], Verification]
"""Judges a log of a task."""

CHECKING = Verification(Verdict.CHECKING, "It is being replayed")


class Verifier:
    """Checks logs one after the other in the background, the last one first; never lets its caller wait.

    Attributes:
        pid: The process at work now, if there is one.
    """

    def __init__(self, check: Check | None = None) -> None:
        """Start nothing yet.

        Args:
            check: What is done in the process; :func:`verify` if None.
        """
        self.pid: int | None = None
        self._check = check or verify
        self._known: dict[Path, Verification] = {}
        # Whoever has just saved one does not wait for all that an earlier session has left.
        self._asked: LifoQueue[tuple[Path, str] | None] = LifoQueue()
        self._closed = threading.Event()
        self._starting = threading.Lock()
        self._thread: threading.Thread | None = None

    def submit(self, path: Path, task: str) -> None:
        """Have a log of a task checked, if it is not waiting for that, and what it holds was not checked before."""
        if self.known(path) == CHECKING:
            return
        if noted := _noted(path):
            self._known[path] = noted
            return
        self._known[path] = CHECKING
        self._asked.put((path, task))
        with self._starting:
            if self._thread is None:
                self._thread = threading.Thread(target=self._work, name="verifier", daemon=True)
                self._thread.start()

    def known(self, path: Path) -> Verification | None:
        """What is known of a log by now; None if it was never submitted."""
        return self._known.get(path)

    def close(self) -> None:
        """End the process; what it is at is not checked."""
        self._closed.set()
        self._asked.put(None)
        if self._thread is not None:
            self._thread.join()

    def _work(self) -> None:
        while (asked := self._asked.get()) is not None and not self._closed.is_set():
            path, task = asked
            verification = self._checked(path, task)
            _note(path, verification)
            self._known[path] = verification

    def _checked(self, path: Path, task: str) -> Verification:
        for _ in range(ATTEMPTS):
            answer = self._ask(path, task)
            if answer or self._closed.wait(_SECONDS_TO_RECOVER):
                return answer or CHECKING
        return Verification(
            Verdict.UNCHECKED,
            f"It is written, but the process that replays it died or did not start, {ATTEMPTS} times; ingestion will "
            "judge it",
        )

    def _ask(self, path: Path, task: str) -> Verification | None:
        """Let a process check a log; None if it dies, or the system has none to give."""
        try:
            with self._checking(path, task) as link:
                while not link.poll(0.1):
                    if self._closed.is_set():
                        return None
                answer: Verification = link.recv()
                return answer
        except (EOFError, OSError):
            return None

    @contextmanager
    def _checking(self, path: Path, task: str) -> Iterator[Connection]:
        """A process that checks a log, and where it answers."""
        spawning = multiprocessing.get_context("spawn")
        link, its_end = spawning.Pipe()
        process = spawning.Process(
            target=_answer, args=(its_end, self._check, path, task), name="verification", daemon=True
        )
        with link:
            with its_end:
                process.start()
            self.pid = process.pid
            try:
                os.setpriority(os.PRIO_PROCESS, process.pid or 0, NICENESS)
                yield link
            finally:
                self.pid = None
                link.close()
                if self._closed.is_set():
                    process.kill()
                process.join(_SECONDS_TO_END)
                process.kill()


def _note(path: Path, verification: Verification) -> None:
    """Put what became of a log beside it, unless another try may come to something else."""
    if verification.verdict not in (Verdict.VERIFIED, Verdict.REJECTED):
        return
    note = _note_of(path)
    # Without a note the log is checked again by the next session.
    with suppress(OSError):
        note.parent.mkdir(exist_ok=True)
        draft = note.with_name(f".{note.name}.draft")
        draft.write_text(json.dumps({"log": digest(path), **asdict(verification)}), encoding="utf-8")
        draft.replace(note)


def _noted(path: Path) -> Verification | None:
    """What was noted of exactly this log; None if that was nothing."""
    try:
        content = json.loads(read_bounded(_note_of(path), MOST_NOTE_BYTES))
        if content["log"] == digest(path):
            return Verification(Verdict(content["verdict"]), printable(content["sentence"], MOST_NOTE_BYTES))
    except (OSError, ValueError, TypeError, KeyError):
        pass
    return None


def _note_of(path: Path) -> Path:
    return path.parent / VERDICTS / f"{path.name}.json"


def verify(path: Path, task: str) -> Verification:
    """Judge a log as ingestion would, then replay it; whatever is wrong with it is the sentence.

    Raises:
        ConfigError: If there is no such task.
    """
    try:
        log = read_log(path)
        Ingestion(IngestionConfig(task=task)).ingest_log(log, path.name)
        steps = replay(log)
    except RejectedLog as error:
        return Verification(Verdict.REJECTED, f"It cannot be used: {error}")
    return Verification(Verdict.VERIFIED, f"Saved: its {steps:,} steps replay bit for bit to a success")


def replay(log: OperatorLog) -> int:
    """Execute a log's actions from its first state, and compare every state with what was recorded.

    Returns:
        Its steps.

    Raises:
        RejectedLog: If a state differs in a single bit, or the last one is no success.
    """
    env = AssemblyEnv(log.task, log.randomness)
    states = np.vstack([log.steps[STATE_KEY], log.final[STATE_KEY]])
    env.set_state(states[0])
    for step, action in enumerate(log.steps["action"]):
        env.step(action)
        if env.get_state().tobytes() != states[step + 1].tobytes():
            raise RejectedLog(f"a replay of its actions leads elsewhere after step {step}")
    if env.outcome is not Outcome.SUCCESS:
        raise RejectedLog("a replay of its actions ends without a success")
    return len(log)


def _answer(link: Connection, check: Check, path: Path, task: str) -> None:
    try:
        link.send(check(path, task))
    except (BrokenPipeError, KeyboardInterrupt):
        return
