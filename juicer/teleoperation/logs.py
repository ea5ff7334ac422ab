"""Where a task's recordings lie: those that are written, and the one in hand."""

from __future__ import annotations

import errno
from contextlib import suppress
from pathlib import Path

import numpy as np

from juicer.artifacts.integrity import sync
from juicer.demonstration.log import SUFFIX, LogFile, OperatorLog, write_log
from juicer.errors import LogNotWritten, RejectedLog
from juicer.teleoperation.drafts import DRAFTS, Beginning, Draft
from juicer.teleoperation.drivers import Driver
from juicer.teleoperation.seeds import claim_next_seed
from juicer.teleoperation.status import Kept
from juicer.teleoperation.take import Take
from juicer.teleoperation.verification import CHECKING, Verdict, Verification, Verifier

KEPT_SHOWN = 5


class Logs:
    """The logs of one task.

    Attributes:
        folder: Where they lie: what ``logs:`` of a configuration names.
    """

    def __init__(self, folder: Path, task: str, verifier: Verifier) -> None:
        """Look at what is there; what was not checked before is.

        Args:
            folder: Where they lie.
            task: What they show.
            verifier: Checks what is written.
        """
        self.folder = folder
        self._task = task
        self._verifier = verifier
        self._draft: Draft | None = None
        self._dropped: Draft | None = None
        self._written: dict[Path, bool | None] = {path: _is_correction(path) for path in _logs_in(folder)}
        """Logs, the oldest first, and whether they are corrections; None if that cannot be read."""
        for path in self._written:
            verifier.submit(path, task)

    def next_seed(self) -> int:
        """Another initial state, see :func:`~juicer.teleoperation.seeds.claim_next_seed`."""
        return claim_next_seed(self.folder)

    def begin(self, beginning: Beginning, take: Take) -> None:
        """An episode's first step is about to be made; what was dropped before it is removed."""
        self._remove_dropped()
        self._draft = Draft(self.folder / DRAFTS, beginning, take.state)

    def go_on_with(self, draft: Draft) -> None:
        """An episode goes on whose draft was left behind."""
        self._draft = draft

    def add(self, take: Take) -> None:
        """A step was made: put it on the disk.

        Raises:
            DraftNotWritten: If the disk refuses it; it is tried again with the next one.
        """
        before, action = take.last_step
        self._in_hand.add(action, idle=take.idle[-1], before=before)

    def add_driver(self, driver: Driver) -> None:
        """Somebody drives from now on, or otherwise."""
        self._in_hand.add_driver(driver)

    def take_back(self, steps: int) -> None:
        """Steps were taken back; there were some.

        Raises:
            DraftNotWritten: As for :meth:`add`.
        """
        self._in_hand.take_back(steps)

    def drop(self) -> None:
        """Nobody wants the episode in hand; it stays on the disk until another begins, for a slip is one key away."""
        self._remove_dropped()
        self._draft, self._dropped = None, self._draft

    def bring_back(self) -> None:
        """The episode that was dropped is in hand again."""
        self._draft, self._dropped = self._dropped, None

    def remove(self) -> None:
        """The episode in hand has no steps: leave nothing of it on the disk."""
        if self._draft:
            self._draft.remove()
            self._draft = None

    def close(self) -> None:
        """Leave the episode in hand, and one that was dropped before it, on the disk, for somebody to take up."""
        for draft in (self._draft, self._dropped):
            if draft:
                draft.close()

    def _remove_dropped(self) -> None:
        if self._dropped:
            self._dropped.remove()
            self._dropped = None

    def keep(self, log: OperatorLog) -> str:
        """Write the episode in hand, whole and onto the disk, and have it checked.

        Returns:
            The name of its log.

        Raises:
            JuicerError: If it cannot be written, or another log has its name; it is still in hand then.
            OSError: As for what a disk refuses otherwise.
        """
        # A rollout may be corrected again and again, so that its seed does not make a name.
        name = f"{log.seed:08d}" if log.parent is None else self._in_hand.name
        path = self.folder / f"{name}{SUFFIX}"
        self._write(path, log)
        self._in_hand.remove()
        self._written[path] = log.parent is not None
        self._verifier.submit(path, self._task)
        return path.name

    def _write(self, path: Path, log: OperatorLog) -> None:
        """Write a log whole and onto the disk; never in place of another, which somebody has driven, too."""
        whole = self.folder / DRAFTS / path.name
        whole.parent.mkdir(parents=True, exist_ok=True)
        write_log(whole, log)
        try:
            sync(whole)
            _give_name(whole, path)
        except FileExistsError:
            # An earlier try may have got this far before the disk refused something.
            if not _shows(path, log):
                reason = "there is a file of that name, which is not replaced; move it elsewhere"
                raise LogNotWritten(errno.EEXIST, reason, str(path)) from None
        finally:
            # What the disk does not let go here must not make a written log one that is not.
            with suppress(OSError):
                whole.unlink(missing_ok=True)
        sync(self.folder)

    @property
    def demonstrations(self) -> int:
        """Demonstrations in the folder, without those that were not, or not yet, found good."""
        return self._good(corrections=False)

    @property
    def corrections(self) -> int:
        """The same of corrections."""
        return self._good(corrections=True)

    def _good(self, *, corrections: bool) -> int:
        good = (Verdict.VERIFIED, Verdict.UNCHECKED)
        return sum(
            self._verification(path).verdict in good
            for path, is_correction in self._written.items()
            if is_correction is corrections
        )

    @property
    def checking(self) -> int:
        """Logs whose check has not come to an end."""
        return sum(self._verification(path) == CHECKING for path in self._written)

    @property
    def kept(self) -> tuple[Kept, ...]:
        """What became of the last episodes in the folder, the newest first."""
        return tuple(Kept(path.name, self._verification(path)) for path in list(self._written)[: -KEPT_SHOWN - 1 : -1])

    def _verification(self, path: Path) -> Verification:
        return self._verifier.known(path) or CHECKING

    @property
    def _in_hand(self) -> Draft:
        assert self._draft is not None, "no episode has begun"
        return self._draft


def _logs_in(folder: Path) -> list[Path]:
    """Logs, the oldest first."""
    times = {}
    for path in folder.glob(f"*{SUFFIX}"):
        with suppress(FileNotFoundError):
            times[path] = (path.stat().st_mtime, path.name)
    return sorted(times, key=lambda path: times[path])


def _is_correction(path: Path) -> bool | None:
    """Whether a log is one; None if it cannot be read."""
    try:
        return LogFile(path).header.parent is not None
    except RejectedLog:
        return None


def _shows(path: Path, log: OperatorLog) -> bool:
    """Whether a file is a log of the same episode."""
    try:
        written = LogFile(path).read()
    except RejectedLog:
        return False
    origins = [(each.task, each.seed, each.parent, each.parent_step) for each in (written, log)]
    return origins[0] == origins[1] and np.array_equal(written.steps["action"], log.steps["action"])


def _give_name(whole: Path, path: Path) -> None:
    """Give a file a name that nothing has.

    Raises:
        FileExistsError: If something has it.
        OSError: If the disk refuses it otherwise.
    """
    try:
        path.hardlink_to(whole)
    except FileExistsError:
        raise
    except OSError as error:
        # Some file systems, exFAT among them, know no second name of a file.
        if path.exists():
            raise FileExistsError(errno.EEXIST, str(path)) from error
        whole.replace(path)
