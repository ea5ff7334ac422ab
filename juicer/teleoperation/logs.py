"""Where a task's recordings lie, and how far each of them is kept."""

from __future__ import annotations

from pathlib import Path

from juicer.artifacts.integrity import sync
from juicer.demonstration.log import SUFFIX, OperatorLog, write_log
from juicer.teleoperation.seeds import claim_next_seed
from juicer.teleoperation.status import Keeping, Kept
from juicer.teleoperation.take import Take


class Logs:
    """The logs of one task.

    Attributes:
        folder: Where they lie: what ``logs:`` of a configuration names.
    """

    def __init__(self, folder: Path) -> None:
        """Look at what is there."""
        self.folder = folder
        self._kept: list[Kept] = []

    def next_seed(self) -> int:
        """Another initial state, see :func:`~juicer.teleoperation.seeds.claim_next_seed`."""
        return claim_next_seed(self.folder)

    def begin(self, take: Take, choice: object) -> None: ...

    def add(self, take: Take) -> None: ...

    def rewind(self, length: int) -> None: ...

    def drop(self) -> None: ...

    def close(self) -> None: ...

    def keep(self, log: OperatorLog) -> str:
        path = self.folder / f"{log.seed:08d}{SUFFIX}"
        write_log(path, log)
        sync(path)
        sync(self.folder)
        self._kept.insert(0, Kept(path.name, Keeping.CHECKING, ""))
        return path.name

    @property
    def saved(self) -> int:
        return sum(1 for _ in self.folder.glob(f"*{SUFFIX}"))

    @property
    def kept(self) -> tuple[Kept, ...]:
        return tuple(self._kept[:5])
