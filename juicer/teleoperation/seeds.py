"""Initial states for people's demonstrations: each once."""

from __future__ import annotations

import errno
from pathlib import Path

from juicer.errors import LogNotWritten, NothingLeft
from juicer.seed_ranges import SEED_RANGES, Purpose

_CLAIMED = "seeds"
_OWN = SEED_RANGES[Purpose.DEMONSTRATIONS]
SEEDS = _OWN[len(_OWN) // 2 :]
"""Half of those for demonstrations: the scripted operator counts from the other end, and both may be mixed."""


def claim_next_seed(folder: Path) -> int:
    """The next initial-state seed that nobody has had who records into this folder; it will not be given again.

    A mark on the disk says so, whatever becomes of the recording and whoever else records at the same time.

    Args:
        folder: Where a task's logs go; it is made if need be.

    Raises:
        LogNotWritten: If the disk refuses the mark.
        NothingLeft: If all have been given.
    """
    claimed = folder / _CLAIMED
    try:
        claimed.mkdir(parents=True, exist_ok=True)
        taken = [int(mark.name) for mark in claimed.iterdir() if mark.name.isdecimal()]
        for seed in range(max([SEEDS[0] - 1, *taken]) + 1, SEEDS[-1] + 1):
            try:
                (claimed / f"{seed:08d}").touch(exist_ok=False)
            except FileExistsError:
                continue
            return seed
    except OSError as error:
        raise LogNotWritten(error.errno or errno.EIO, error.strerror or "the disk refuses", str(claimed)) from None
    raise NothingLeft(f"all {len(SEEDS):,} initial states for demonstrations by people were used in '{folder}'")
