"""Initial states for people's demonstrations: each once."""

from __future__ import annotations

import errno
import re
from pathlib import Path

from juicer.artifacts.writing import disk_refusal
from juicer.demonstration.log import SUFFIX as LOG_SUFFIX
from juicer.errors import LogNotWritten, NothingLeft
from juicer.seed_ranges import SEED_RANGES, Purpose
from juicer.teleoperation.drafts import DRAFTS
from juicer.teleoperation.drafts import SUFFIX as DRAFT_SUFFIX

_CLAIMED = "seeds"
_OWN = SEED_RANGES[Purpose.DEMONSTRATIONS]
SEEDS = _OWN[len(_OWN) // 2 :]
"""Half of those for demonstrations: the scripted operator counts from the other end, and both may be mixed."""


def claim_next_seed(folder: Path) -> int:
    """The next initial-state seed that nobody has had who records into this folder; it will not be given again.

    A mark on the disk says so, whatever becomes of the recording and whoever else records at the same time. Recordings
    that came without their marks, from a copy or a backup, count as well, and so do interrupted episodes.

    Args:
        folder: Where a task's logs go; it is made if need be.

    Raises:
        LogNotWritten: If the disk refuses the mark.
        NothingLeft: If all have been given.
    """
    claimed = folder / _CLAIMED
    try:
        claimed.mkdir(parents=True, exist_ok=True)
        files = [*claimed.iterdir(), *folder.glob(f"*{LOG_SUFFIX}"), *folder.glob(f"{DRAFTS}/*{DRAFT_SUFFIX}")]
        taken = [seed for seed in map(_seed_of, files) if seed in SEEDS]
        for seed in range(max([SEEDS[0] - 1, *taken]) + 1, SEEDS[-1] + 1):
            try:
                (claimed / f"{seed:08d}").touch(exist_ok=False)
            except FileExistsError:
                continue
            return seed
    except OSError as error:
        reason = disk_refusal(error, folder) or error.strerror or "the disk refuses"
        raise LogNotWritten(error.errno or errno.EIO, reason, str(claimed)) from None
    raise NothingLeft(f"all {len(SEEDS):,} initial states for demonstrations by people were used in '{folder}'")


def _seed_of(file: Path) -> int:
    """The seed that the name of a mark, a log or a draft begins with; -1 if it begins with none."""
    digits = re.match(r"\d{8}(?!\d)", file.name)
    return int(digits.group()) if digits else -1
