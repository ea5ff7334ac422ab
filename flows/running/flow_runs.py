"""Flow runs whose process is gone without having said so: Prefect would show them as running for ever."""

from __future__ import annotations

import base64
import fcntl
import json
import logging
import os
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from uuid import UUID

from flows.running.data_folder import PRIVATE

FOLDER = ".flow-runs"
CRASHED = {"type": "CRASHED", "name": "Crashed", "message": "The process was killed; the same command goes on."}
REQUEST_SECONDS = 5.0
RETRY_SECONDS = 0.5
KEPT_SECONDS = 30 * 86400.0
"""How long a flow run of a server that is not there is remembered."""

_UNFINISHED = ("RUNNING", "PENDING", "CANCELLING")
logger = logging.getLogger(__name__)


@contextmanager
def held(folder: Path, flow_run: object) -> Iterator[None]:
    """Show, for the length of a block, that the process of a flow run lives.

    The kernel frees the lock when the process ends, however it ends.
    """
    path = folder / FOLDER / str(flow_run)
    draft = path.with_name(f"{path.name}.{os.getpid()}")
    try:
        path.parent.mkdir(exist_ok=True)
        descriptor = os.open(draft, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, PRIVATE)
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        # Under the name that others look for only now, when its lock is held.
        draft.replace(path)
    except OSError:
        # Nobody's work depends on it.
        logger.debug("'%s' cannot be written", path, exc_info=True)
        yield
        return
    try:
        yield
    finally:
        path.unlink(missing_ok=True)
        os.close(descriptor)


def mark_crashed(folder: Path, api: str, password: str | None) -> None:
    """Tell a Prefect server which of its flow runs have no process any more.

    Args:
        folder: The data folder.
        api: Address of the server's API.
        password: What it asks for, as ``user:password``.
    """
    for path in sorted((folder / FOLDER).glob("*")):
        with _claimed(path) as is_ours:
            if not is_ours:
                continue
            try:
                is_done = _mark(api, password, UUID(path.name))
            except (OSError, ValueError):
                logger.debug("flow run '%s' cannot be marked", path.name, exc_info=True)
                is_done = False
            if is_done or time.time() - path.stat().st_mtime > KEPT_SECONDS:
                path.unlink(missing_ok=True)


@contextmanager
def _claimed(path: Path) -> Iterator[bool]:
    """Whether the process that held a file is gone, and no other claims it at the same moment."""
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC)
    except OSError:
        yield False
        return
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        yield False
    else:
        yield path.exists()
    finally:
        os.close(descriptor)


def _mark(api: str, password: str | None, flow_run: UUID) -> bool:
    """Whether the server knows the flow run, which is marked then."""

    def call(path: str, content: dict[str, Any] | None = None) -> Any:
        data = None if content is None else json.dumps(content).encode()
        request = urllib.request.Request(f"{api}{path}", data, {"Content-Type": "application/json"})
        if password:
            request.add_header("Authorization", f"Basic {base64.b64encode(password.encode()).decode()}")
        for is_last in (False, False, True):
            try:
                with urllib.request.urlopen(request, timeout=REQUEST_SECONDS) as response:
                    return json.load(response)
            except urllib.error.HTTPError as error:
                # The server asks to be asked again, as its database is locked at the moment.
                if error.code != 503 or is_last:
                    raise
                time.sleep(RETRY_SECONDS)
        return None

    try:
        state = call(f"/flow_runs/{flow_run}").get("state_type")
    except urllib.error.HTTPError as error:
        if error.code == 404:
            return False
        raise
    if state in _UNFINISHED:
        mine = {"flow_runs": {"id": {"any_": [str(flow_run)]}}, "task_runs": {"state": {"type": {"any_": _UNFINISHED}}}}
        for task_run in call("/task_runs/filter", mine):
            call(f"/task_runs/{task_run['id']}/set_state", {"state": CRASHED, "force": True})
        call(f"/flow_runs/{flow_run}/set_state", {"state": CRASHED, "force": True})
    return True
