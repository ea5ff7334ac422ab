"""What every page works with."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from fastapi import Depends
from starlette.requests import HTTPConnection

from juicer.artifacts.store import ArtifactStore


def _nowhere() -> Mapping[str, str]:
    return {}


@dataclass(frozen=True)
class Workplace:
    """The store, the machine, and where else there is something to see.

    Attributes:
        store: The artifacts.
        folder: The data folder: what pages write that is no artifact is below it.
        workers: Processes or threads that computing for a page may keep busy.
        servers: Gives the addresses of other pages by name at this moment, such as MLflow's; they come and go.
    """

    store: ArtifactStore
    folder: Path
    workers: int = 1
    servers: Callable[[], Mapping[str, str]] = _nowhere


def _workplace(connection: HTTPConnection) -> Workplace:
    workplace: Workplace = connection.app.state.workplace
    return workplace


TheWorkplace = Annotated[Workplace, Depends(_workplace)]
"""Type of a route's parameter, HTTP or WebSocket, that is the workplace."""
