"""The journal of one MLflow run: events in order, in a local file that only grows.

Everything is written here first and delivered to MLflow from here, so nothing is lost if its server is away or
the process is killed; the journal is delivered when either is back.
"""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Self

from filelock import FileLock, Timeout

SUFFIX = ".jsonl"
RUN, METRICS, MADE, RESULT, END, RESUMED = "run", "metrics", "made", "result", "end", "resumed"
FINISHED, FAILED, KILLED = "FINISHED", "FAILED", "KILLED"
"""How a run ends, in MLflow's words."""


@dataclass(frozen=True)
class Entry:
    """An event of a journal and the offset of its end in the file."""

    content: Mapping[str, Any]
    end: int


class Journal:
    """One file of events; whoever writes to it holds its lock."""

    def __init__(self, folder: Path, key: str) -> None:
        """Name a journal; nothing is created yet."""
        self.key = key
        self.path = folder / f"{key}{SUFFIX}"
        self._lock = FileLock(folder / f"{key}.lock")

    def begin(self) -> None:
        """Become its writer; another process that writes to the same journal is no harm, but then the lock is its."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        try:
            self._lock.acquire(timeout=0)
        except Timeout:
            return
        if self.path.exists() and not self.path.read_bytes().endswith(b"\n"):
            # A kill in mid-write left half a line, which must not swallow the next one.
            with self.path.open("a") as file:
                file.write("\n")

    def finish(self) -> None:
        """Stop being its writer."""
        self._lock.release()

    def bury(self) -> None:
        """Write down that the run was killed, if it has not ended and nobody writes to it any more."""
        try:
            with self._lock.acquire(timeout=0):
                entries = self.entries()
                if entries and entries[-1].content["event"] != END:
                    self.append(END, status=KILLED)
        except Timeout:
            return

    def append(self, event: str, **content: Any) -> None:
        """Write an event with the present time in milliseconds."""
        line = json.dumps({"event": event, "time": round(1000 * time.time()), **content})
        with self.path.open("a") as file:
            file.write(line + "\n")

    def entries(self, start: int = 0) -> list[Entry]:
        """Events from an offset on; half a line at the end is not yet an event."""
        if not self.path.exists():
            return []
        entries = []
        with self.path.open("rb") as file:
            file.seek(start)
            for line in file:
                if not line.endswith(b"\n"):
                    break
                start += len(line)
                try:
                    entries.append(Entry(json.loads(line), start))
                except ValueError:
                    continue
        return entries


@dataclass
class DeliveryState:
    """How far a journal was delivered, and as which MLflow run."""

    run_id: str = ""
    experiment_id: str = ""
    offset: int = 0

    @classmethod
    def load(cls, journal: Journal) -> Self:
        """State of a journal; one that was never delivered, or whose state is lost, starts at the beginning."""
        try:
            state = cls(**json.loads(_state_path(journal).read_text()))
        except (OSError, ValueError, TypeError):
            return cls()
        kinds = ((state.run_id, str), (state.experiment_id, str), (state.offset, int))
        return state if all(isinstance(value, kind) for value, kind in kinds) else cls()

    def save(self, journal: Journal) -> None:
        """Replace the state of a journal."""
        path = _state_path(journal)
        draft = path.with_suffix(".draft")
        draft.write_text(json.dumps(asdict(self)))
        draft.replace(path)


def _state_path(journal: Journal) -> Path:
    return journal.path.with_name(f"{journal.key}.state.json")


def journals(folder: Path) -> list[Journal]:
    """Every journal of a folder, oldest first."""
    paths = sorted(folder.glob(f"*{SUFFIX}"), key=lambda path: path.stat().st_mtime)
    return [Journal(folder, path.name.removesuffix(SUFFIX)) for path in paths]
