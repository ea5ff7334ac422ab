"""How much of the machine a stage may use; a device that a stage needs to itself is leased."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

from filelock import FileLock, Timeout

from juicer.errors import ServiceUnavailable
from juicer.policy.pretrained.files import DEFAULT_FOLDER

CPU = "cpu"
POLL_SECONDS = 0.5


@dataclass(frozen=True)
class Machine:
    """What stages may use of the machine they run on; none of it shapes a result, but for last digits.

    Attributes:
        workers: Threads or processes that a stage may keep busy.
        num_envs: Simulated environments that a rollout steps side by side.
        devices: Torch devices: each takes one training at a time; policies act on the first.
        leases: Folder of the locks that say which device is taken; one that all runs of a user share if None.
        weights: Where files of pretrained weights are looked for first.
    """

    workers: int = 1
    num_envs: int = 8
    devices: tuple[str, ...] = (CPU,)
    leases: Path | None = None
    weights: Path = DEFAULT_FOLDER

    @property
    def device(self) -> str:
        """The first device; the only one where it has been leased."""
        return self.devices[0]

    @contextmanager
    def leased(self, wait: Callable[[], None]) -> Iterator[Self]:
        """The machine with the first device that is free, which is nobody else's for the length of a block.

        Processors need no lease. The kernel frees the lease of a process that ends, however it ends.

        Args:
            wait: Called again and again while all devices are taken; it may raise to give up.

        Raises:
            ServiceUnavailable: If there is no place for leases.
        """
        if self.devices == (CPU,):
            yield self
            return
        folder = self.leases or _shared_folder()
        while (lease := _free_one(folder, self.devices)) is None:
            wait()
            time.sleep(POLL_SECONDS)
        device, lock = lease
        try:
            yield replace(self, devices=(device,))
        finally:
            lock.release()


def _free_one(folder: Path, devices: tuple[str, ...]) -> tuple[str, FileLock] | None:
    for device in devices:
        lock = FileLock(folder / f"{_unit(device)}.lock")
        try:
            lock.acquire(timeout=0)
        except Timeout:
            continue
        return device, lock
    return None


def _unit(device: str) -> str:
    """Which unit of the machine a device is, whatever part of it this process is shown."""
    kind, _, number = device.partition(":")
    shown = [each for each in os.environ.get("CUDA_VISIBLE_DEVICES", "").split(",") if each]
    place = int(number or 0)
    return f"{kind}-{shown[place] if place < len(shown) else place}"


def _shared_folder() -> Path:
    folder = Path(tempfile.gettempdir()) / f"juicer-devices-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    if folder.is_symlink() or folder.stat().st_uid != os.getuid():
        raise ServiceUnavailable(f"'{folder}', where devices are leased, belongs to another user; remove it")
    return folder
