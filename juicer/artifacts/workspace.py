"""Work in progress beside the artifacts: drafts, scratch and locks in ``<root>/.work/``, by artifact id."""

from __future__ import annotations

import logging
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from filelock import BaseFileLock, FileLock, Timeout

from juicer.artifacts.ref import KINDS, ArtifactRef, is_id

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

    def grave(self, ref: ArtifactRef) -> Path:
        """Where an artifact waits for its successor to take its place; belongs to whoever holds the lock."""
        return self.root / "graves" / f"{ref.id}.{ref.kind}"

    def graves(self) -> list[ArtifactRef]:
        """Every artifact that waits so."""
        names = [path.name.split(".") for path in _children(self.root / "graves")]
        return [
            ArtifactRef(name[1], name[0]) for name in names if len(name) == 2 and is_id(name[0]) and name[1] in KINDS
        ]

    @contextmanager
    def lock(self, identity: str, waiting: Callable[[], None] = lambda: None) -> Iterator[None]:
        """Hold the lock of an id, after waiting for it.

        The kernel takes the lock from a dead owner, so that no death can block an id.

        Args:
            identity: The id.
            waiting: Called again and again while another process holds the lock; ends the wait by raising.
        """
        lock = self._lock(identity)
        if not _acquire_at_once(lock):
            logger.info("waiting for another process that works on %s", identity)
            while not _acquire_at_once(lock):
                waiting()
                time.sleep(_POLL_S)
        with _releasing(lock):
            yield

    @contextmanager
    def lock_if_free(self, identity: str) -> Iterator[bool]:
        """Hold the lock of an id for the length of a block if nobody else does; gives whether it is held."""
        lock = self._lock(identity)
        if not _acquire_at_once(lock):
            yield False
            return
        with _releasing(lock):
            yield True

    def sweep(self, made_at: Callable[[str], float | None]) -> None:
        """Delete what dead processes left: drafts, locks, and scratch of ids that were finished after all.

        Only what is named as this class names it goes.

        Args:
            made_at: Gives when the artifact of an id was made, in seconds since 1970, if it exists. Scratch that is
                younger belongs to an attempt to make it again, and stays.
        """
        drafts = {path.name for path in _children(self.root / "drafts")}
        locks = {path.stem for path in _children(self.root / "locks") if path.suffix == ".lock"}
        scratch = {
            path.name
            for path in _children(self.root / "scratch")
            if (time := made_at(path.name)) is not None and path.stat().st_mtime <= time
        }
        for identity in filter(is_id, sorted(drafts | scratch | locks)):
            with self.lock_if_free(identity) as is_held:
                if is_held:
                    discard_tree(self.draft(identity))
                    if identity in scratch:
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
    """Delete a folder and all below it, if it is there; of a link, only the link."""
    if folder.is_symlink() or folder.is_file():
        folder.unlink()
    elif folder.exists():
        shutil.rmtree(folder)


def discard_tree(folder: Path) -> None:
    """Delete as much of a folder as the disk allows; the rest is left to a later sweep."""
    shutil.rmtree(folder, ignore_errors=True)


def _children(folder: Path) -> list[Path]:
    return sorted(folder.iterdir()) if folder.is_dir() else []
