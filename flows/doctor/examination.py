"""Every check, each on its own: one that fails or hangs is a finding about the machine, never the end of the others."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError

from flows.doctor.drawing import check_drawing
from flows.doctor.libraries import check_libraries, check_python, check_torch
from flows.doctor.machine import check_clock, check_cores, check_disk, check_memory, check_temporary_files
from flows.doctor.places import check_data_folder, check_leftovers, check_store
from flows.doctor.program import PATIENCE_SECONDS
from flows.doctor.surroundings import check_ports, check_prefect, check_proxies, check_tracking, check_variables
from flows.doctor.verdict import Check, Verdict, problem, warning
from flows.running.settings import PREFIX, Settings
from juicer.errors import JuicerError
from juicer.text import printable

CHECKS: Mapping[str, Check] = {
    "python": check_python,
    "libraries": check_libraries,
    "torch": check_torch,
    "drawing": check_drawing,
    "processors": check_cores,
    "memory": check_memory,
    "disk": check_disk,
    "temporary": check_temporary_files,
    "clock": check_clock,
    "variables": check_variables,
    "data": check_data_folder,
    "store": check_store,
    "leftovers": check_leftovers,
    "proxies": check_proxies,
    "prefect": check_prefect,
    "ports": check_ports,
    "tracking": check_tracking,
}
LONGEST_MESSAGE = 500
DEADLINE_SECONDS = PATIENCE_SECONDS + 5.0


@dataclass(frozen=True)
class Examined:
    """What a check found."""

    name: str
    verdict: Verdict


def examine(checks: Mapping[str, Check] = CHECKS, deadline_s: float = DEADLINE_SECONDS) -> list[Examined]:
    """Run all checks side by side, and report in their order."""
    settings, wrong = usable_settings()
    running = {name: _Running(check, settings) for name, check in checks.items()}
    ends = time.monotonic() + deadline_s
    found = [Examined("settings", verdict) for verdict in wrong]
    for name, each in running.items():
        found += [Examined(name, verdict) for verdict in each.verdicts(ends)]
    return found


def usable_settings() -> tuple[Settings, list[Verdict]]:
    """Settings of this process, with defaults in place of what is not valid, and what that is."""
    replaced: dict[str, Any] = {}
    wrong: list[Verdict] = []
    while True:
        try:
            return Settings(**replaced), wrong
        except ValidationError as error:
            first = error.errors(include_url=False, include_context=False)[0]
            name = str(first["loc"][0]) if first["loc"] else ""
            if name in replaced or name not in Settings.model_fields:
                return Settings.model_construct(), [problem(printable(first["msg"]), "look at the variables")]
            variable = f"{PREFIX}{name.upper()}"
            value = printable(os.environ.get(variable, ""))
            message = printable(first["msg"].removeprefix("Value error, "))
            wrong.append(
                problem(f"{variable}: {message}, got '{value}'", f"set it to another value, or unset {variable}")
            )
            replaced[name] = Settings.model_fields[name].get_default(call_default_factory=True)


class _Running:
    """A check in a thread that does not keep the process alive: a disk that does not answer holds its reader."""

    def __init__(self, check: Check, settings: Settings) -> None:
        self._check = check
        self._settings = settings
        self._verdicts: list[Verdict] = []
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def verdicts(self, ends: float) -> list[Verdict]:
        self._thread.join(max(0.0, ends - time.monotonic()))
        verdicts = list(self._verdicts)
        if self._thread.is_alive():
            verdicts.append(warning("this was not found out in time", "look at what the machine is busy with"))
        return verdicts

    def _run(self) -> None:
        try:
            for verdict in self._check(self._settings):
                self._verdicts.append(verdict)
        except JuicerError as error:
            message, _, remedy = printable(error, LONGEST_MESSAGE).partition("; ")
            self._verdicts.append(problem(message, remedy or "see to that first"))
        except OSError as error:
            reason = printable(f"{error.strerror or type(error).__name__}: '{error.filename or error}'")
            self._verdicts.append(problem(reason, "see to its permissions, or name another place"))
        except Exception as error:
            reason = printable(f"{type(error).__name__}: {error}")
            self._verdicts.append(problem(f"this could not be found out ({reason})", "see to that first"))
