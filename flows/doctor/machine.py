"""The machine itself: processors, memory, disks, temporary files, the clock."""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from flows.doctor.verdict import Verdict, ok, problem, warning
from flows.running.capacity import LEAST_MEMORY, MEMORY_A_STAGE, available_memory, usable_cores
from flows.running.settings import Settings

FULL_BYTES, TIGHT_BYTES = 0.5e9, 5e9
"""Free bytes below which a disk counts as full, and below which as tight."""
OLDEST_YEAR = 2026


def check_cores(settings: Settings) -> Iterator[Verdict]:
    """Processors against the stages that run at a time."""
    cores = usable_cores()
    found = f"{cores:g} processor{'s' if cores != 1 else ''}, JUICER_WORKERS is {settings.workers}"
    if settings.workers > max(1.0, cores) and not settings.cluster:
        yield warning(found, f"set JUICER_WORKERS={max(1, int(cores))}: more stages at a time slow each other down")
    else:
        yield ok(found)


def check_memory(settings: Settings) -> Iterator[Verdict]:
    """Free memory against what the stages that run at a time may need."""
    free = available_memory()
    needed = LEAST_MEMORY + MEMORY_A_STAGE * settings.workers
    found = f"{free / 1e9:.1f} GB of memory are free"
    if free < needed:
        yield warning(
            f"{found}, {settings.workers} stages at a time may need {needed / 1e9:.1f}",
            "close other programs, or lower JUICER_WORKERS and JUICER_NUM_ENVS",
        )
    else:
        yield ok(found)


def check_disk(settings: Settings) -> Iterator[Verdict]:
    """Free space where data and temporary files go."""
    places = {"the data folder": settings.folder, "temporary files": Path(tempfile.gettempdir())}
    for name, folder in places.items():
        existing = next(each for each in (folder, *folder.parents) if each.exists())
        free = shutil.disk_usage(existing).free
        found = f"{free / 1e9:.1f} GB are free for {name} ('{existing}')"
        remedy = "free some space, or set JUICER_DATA" if name == "the data folder" else "free some, or set TMPDIR"
        if free < FULL_BYTES:
            yield problem(found, remedy)
        elif free < TIGHT_BYTES:
            yield warning(found, remedy)
        else:
            yield ok(found)


def check_temporary_files(settings: Settings) -> Iterator[Verdict]:
    """Whether temporary files and sockets can be made where they belong."""
    wanted = os.environ.get("TMPDIR", "")
    folder = tempfile.gettempdir()
    if wanted and Path(wanted).absolute() != Path(folder).absolute():
        yield warning(f"TMPDIR is '{wanted}', which cannot be used; '{folder}' is", "make that folder, or unset TMPDIR")
    with tempfile.TemporaryFile(dir=folder) as file:
        file.write(b"juicer")
    yield ok(f"temporary files go to '{folder}'")


def check_clock(settings: Settings) -> Iterator[Verdict]:
    """Whether the time can be right: artifacts and records are put in order by it."""
    now = time.localtime()
    shown = time.strftime("%Y-%m-%d %H:%M:%S %Z", now)
    if now.tm_year < OLDEST_YEAR:
        yield problem(f"the clock says {shown}", "set the clock; certificates and the order of artifacts depend on it")
    else:
        yield ok(f"the clock says {shown}")
