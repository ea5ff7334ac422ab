"""Where the stages of flows run: on threads of this process, each with a process of its own, on Dask, or on Ray.

The task runners are Prefect's. What travels to a worker of Dask or Ray is a stage call as data and the address of the
store; the worker opens the store itself, and uses its machine as its own settings say.
"""

from __future__ import annotations

import logging
import os
import signal
from typing import Any, cast

from prefect.futures import PrefectFuture
from prefect.task_runners import TaskRunner, ThreadPoolTaskRunner

from flows.running.settings import RUNNER_VARIABLE, Settings, read_settings
from juicer.artifacts.store import ArtifactStore
from juicer.errors import ConfigError
from juicer.text import adding_extra
from stages.runtime.cluster import Opener
from stages.runtime.execution import perform_here
from stages.runtime.session import Session


def task_runner() -> TaskRunner[PrefectFuture[Any]]:
    """As many stages at a time as this machine's settings allow, or as a cluster has workers.

    Raises:
        ConfigError: If the settings name a cluster whose library is not installed.
    """
    settings = read_settings()
    runner: Any
    try:
        if settings.runner_kind == "dask":
            runner = _dask(settings)
        elif settings.runner_kind == "ray":
            runner = _ray(settings)
        else:
            runner = ThreadPoolTaskRunner(max_workers=settings.workers)
    except ModuleNotFoundError as error:
        raise ConfigError(
            f"environment variable {RUNNER_VARIABLE}: {error.name} is not installed; "
            f"{adding_extra(settings.runner_kind)}"
        ) from None
    return cast("TaskRunner[PrefectFuture[Any]]", runner)


def _dask(settings: Settings) -> Any:
    # What its processes say of an interrupt, or of one of them that was killed, would stand between progress lines.
    os.environ.setdefault("DASK_LOGGING__DISTRIBUTED", "critical")
    os.environ.setdefault("PYTHONWARNINGS", "ignore:resource_tracker:UserWarning")
    from prefect_dask.task_runners import DaskTaskRunner  # an extra, as is Ray

    if settings.cluster:
        return DaskTaskRunner(address=settings.cluster)
    # One stage at a time in each process: stages share torch's global switches.
    return DaskTaskRunner(
        cluster_kwargs={
            "n_workers": settings.workers,
            "threads_per_worker": 1,
            "memory_limit": None,
            "host": "127.0.0.1",
            "dashboard_address": None,
            "preload": __name__,
            # Other users of this machine reach the scheduler too, and could run anything.
            "security": True,
        }
    )


def dask_setup(worker: object) -> None:
    """Called by Dask in each worker on this machine: only the run decides what an interrupt from the keyboard means."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _ray(settings: Settings) -> Any:
    # Devices are leased by juicer; Ray would hide them from tasks that ask it for none.
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    from prefect_ray.task_runners import RayTaskRunner

    if settings.cluster:
        return RayTaskRunner(address=settings.cluster)
    quiet = {"include_dashboard": False, "log_to_driver": False, "logging_level": logging.CRITICAL}
    return RayTaskRunner(init_kwargs={"num_cpus": settings.workers, **quiet})


def opener(settings: Settings) -> Opener | None:
    """What opens the store where stages run, if that is not in this process."""
    return None if settings.runner_kind == "threads" else open_there


def open_there(url: str) -> Session:
    """What the stages of a worker share, by that worker's own settings.

    Args:
        url: Address of the artifact store, which all workers share.
    """
    settings = read_settings()
    store = ArtifactStore(url, cache=settings.folder / "cache")
    return Session(store, perform_here, machine=settings.machine)
