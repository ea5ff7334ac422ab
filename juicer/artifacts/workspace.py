"""Work in progress beside the artifacts: drafts, scratch and locks in ``<root>/.work/``, by artifact id."""

from __future__ import annotations

import logging
import shutil
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from filelock import BaseFileLock, FileLock, Timeout

logger = logging.getLogger(__name__)

_POLL_S = 0.1


@dataclass(frozen=True)
class Workspace:
    """Hidden folders for what is not an artifact yet."""

    root: Path

    def draft(self, identity: str) -> Path:
        """Where the files of an unfinished artifact grow; belongs to whoever holds the lock."""
        return self.root / "drafts" / identity

    def scratch(self, identity: str) -> Path:
        """What a killed run leaves to its successor; belongs to whoever holds the lock."""
        return self.root / "scratch" / identity

    def grave(self, identity: str) -> Path:
        """Where an artifact waits for its deletion; belongs to whoever holds the lock."""
        return self.root / "graves" / identity

    @contextmanager
    def lock(self, identity: str) -> Iterator[None]:
        """Hold the lock of an id, after waiting for it.

        The kernel takes the lock from a dead owner, so that no death can block an id.
        """
        lock = self._lock(identity)
        if not _acquire_at_once(lock):
            logger.info("waiting for another process that works on %s", identity)
            lock.acquire(poll_interval=_POLL_S)
        with _releasing(lock):
            yield

    def sweep(self, finished: Collection[str]) -> None:
        """Delete what dead processes left: drafts, graves, locks, and scratch of ids that were finished after all."""
        drafts = {path.name for path in _children(self.root / "drafts")}
        graves = {path.name for path in _children(self.root / "graves")}
        scratch = {path.name for path in _children(self.root / "scratch")}
        locks = {path.stem for path in _children(self.root / "locks")}
        for identity in sorted(drafts | graves | scratch.intersection(finished) | locks):
            lock = self._lock(identity)
            if _acquire_at_once(lock):
                with _releasing(lock):
                    discard_tree(self.draft(identity))
                    discard_tree(self.grave(identity))
                    if identity in finished:
                        discard_tree(self.scratch(identity))

    def _lock(self, identity: str) -> BaseFileLock:
        path = self.root / "locks" / f"{identity}.lock"
        path.parent.mkdir(parents=True, exist_ok=True)
        return FileLock(path)


def _acquire_at_once(lock: BaseFileLock) -> bool:
    try:
        lock.acquire(timeout=0)
    except Timeout:
        return False
    return True


@contextmanager
def _releasing(lock: BaseFileLock) -> Iterator[None]:
    try:
        yield
    finally:
        try:
            # Unlinked while held: a waiter that then gets the old file notices, and opens the path again.
            Path(lock.lock_file).unlink(missing_ok=True)
        finally:
            lock.release()


def delete_tree(folder: Path) -> None:
    """Delete a folder and all below it, if it is there."""
    if folder.exists():
        shutil.rmtree(folder)


def discard_tree(folder: Path) -> None:
    """Delete as much of a folder as the disk allows; the rest is left to a later sweep."""
    shutil.rmtree(folder, ignore_errors=True)


def _children(folder: Path) -> list[Path]:
    return sorted(folder.iterdir()) if folder.is_dir() else []
