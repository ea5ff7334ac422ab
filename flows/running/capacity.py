"""What this machine, or the container around this process, has to offer."""

from __future__ import annotations

import os
from pathlib import Path

LEAST_MEMORY, MEMORY_A_STAGE = 1.0e9, 0.8e9
"""Bytes of Prefect's server with the command, and of a stage with torch and MuJoCo."""

_CGROUP = Path("/sys/fs/cgroup")


def stages_at_a_time() -> int:
    """Stages for which there are processors and memory: each computes on one core for most of its time."""
    return max(1, min(int(usable_cores()), int((available_memory() - LEAST_MEMORY) / MEMORY_A_STAGE)))


def usable_cores() -> float:
    """Processors that this process may use, a container's limit included."""
    cores = float(len(os.sched_getaffinity(0)))
    quota, _, period = _read(_CGROUP / "cpu.max").partition(" ")
    return min(cores, int(quota) / int(period)) if quota.isdigit() else cores


def available_memory() -> float:
    """Bytes that can be had without swapping, a container's limit included."""
    lines = dict(line.split(":", 1) for line in Path("/proc/meminfo").read_text().splitlines())
    free = 1024.0 * int(lines["MemAvailable"].split()[0])
    limit, used = _read(_CGROUP / "memory.max"), _read(_CGROUP / "memory.current")
    if not (limit.isdigit() and used.isdigit()):
        return free
    # Copies of files are given up for whoever needs memory.
    statistics = dict(line.split() for line in _read(_CGROUP / "memory.stat").splitlines())
    return min(free, int(limit) - int(used) + int(statistics.get("inactive_file", 0)))


def _read(path: Path) -> str:
    try:
        return path.read_text().strip()
    except OSError:
        return ""
