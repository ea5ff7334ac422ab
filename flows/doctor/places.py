"""Where juicer keeps things: the data folder, the store, and what dead runs have left there."""

from __future__ import annotations

import fcntl
import os
import pwd
import stat
import tempfile
import time
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path

from flows.doctor.verdict import Verdict, ok, problem, warning
from flows.running.data_folder import open_store
from flows.running.settings import Settings
from juicer.artifacts.ref import ArtifactRef
from juicer.artifacts.store import ArtifactStore
from juicer.errors import UnreadableArtifact

NOTABLE_SKEW_SECONDS = 5.0


def check_data_folder(settings: Settings) -> Iterator[Verdict]:
    """Whether the data folder is there or can be made, is the user's own, and takes a file."""
    folder = settings.folder
    existing = next(each for each in (folder, *folder.parents) if each.exists())
    remedy = "change its owner or permissions, or set JUICER_DATA to another folder"
    if not existing.is_dir():
        yield problem(f"'{existing}' is no folder", "set JUICER_DATA to one")
        return
    if not os.access(existing, os.R_OK | os.W_OK | os.X_OK):
        yield problem(f"'{existing}' cannot be read and written by {_name(os.geteuid())}", remedy)
        return
    if existing != folder:
        yield ok(f"'{folder}' is not there yet; the first run makes it")
        return
    status = folder.stat()
    if status.st_uid != os.geteuid():
        yield warning(f"'{folder}' belongs to {_name(status.st_uid)}, not to {_name(os.geteuid())}", remedy)
    if status.st_mode & stat.S_IWOTH:
        yield warning(f"everybody on this machine can write into '{folder}'", f"chmod o-w '{folder}'")
    with tempfile.NamedTemporaryFile(dir=folder, prefix=".doctor-") as file:
        file.write(b"juicer")
        file.flush()
        skew = os.fstat(file.fileno()).st_mtime - time.time()
    if abs(skew) > NOTABLE_SKEW_SECONDS:
        yield warning(f"the clock of the disk under '{folder}' is {skew:+.0f} s off", "set the clock of its server")
    yield ok(f"'{folder}' can be written")


def check_store(settings: Settings) -> Iterator[Verdict]:
    """Whether the store answers, and what it says of its artifacts."""
    store = open_store(settings)
    listing = store.survey()
    for place in listing.unseen:
        yield problem(f"in '{store.url}' {place}", "see to its owner and permissions")
    manifests = store.list()
    known = {manifest.ref for manifest in manifests}
    # What a run removes meanwhile is not there.
    if unreadable := sum(_is_there(store, ref) for ref in listing.refs if ref not in known):
        among = f"{unreadable} of {unreadable + len(manifests)} artifacts"
        yield problem(f"{among} in '{store.url}' cannot be read", "see `juicer verify`")
    latest = max((datetime.fromisoformat(manifest.finished) for manifest in manifests), default=None)
    if latest and (ahead := latest.timestamp() - time.time()) > NOTABLE_SKEW_SECONDS:
        yield warning(f"an artifact was finished {ahead:.0f} s from now", "compare the clocks of the machines")
    yield ok(f"{len(manifests)} artifacts in '{store.url}'")


def _is_there(store: ArtifactStore, ref: ArtifactRef) -> bool:
    try:
        return store.exists(ref)
    except UnreadableArtifact:
        return True


def check_leftovers(settings: Settings) -> Iterator[Verdict]:
    """What runs that were killed have left beside the artifacts."""
    work = open_store(settings).cache / ".work"
    drafts = [path for path in _children(work / "drafts") if not _is_held(work / "locks" / f"{path.name}.lock")]
    locks = [path for path in _children(work / "locks") if not _is_held(path)]
    scratch = [path for path in _children(work / "scratch") if not _is_held(work / "locks" / f"{path.name}.lock")]
    if drafts or locks:
        yield warning(
            f"killed runs left {len(drafts)} drafts and {len(locks)} locks in '{work}'",
            "nothing: the next stage that is computed removes them",
        )
    if scratch:
        yield ok(f"{len(scratch)} unfinished trainings wait in '{work / 'scratch'}' to be resumed")
    if not (drafts or locks or scratch):
        yield ok("no run has left anything unfinished")


def _children(folder: Path) -> list[Path]:
    return sorted(folder.iterdir()) if folder.is_dir() else []


def _is_held(lock: Path) -> bool:
    """Whether a living process holds a lock; asked without taking it from anybody."""
    try:
        descriptor = os.open(lock, os.O_RDONLY | os.O_CLOEXEC)
    except FileNotFoundError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(descriptor)
    return False


def _name(user: int) -> str:
    try:
        return pwd.getpwuid(user).pw_name
    except KeyError:
        return f"user {user}"
