"""Brings together what a run needs: the store, the progress lines, the records and their delivery."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from flows.board import Board
from flows.config import RunConfig
from flows.data_folder import sqlite_address
from flows.plan import PlannedCall
from flows.settings import Settings
from flows.store import open_store
from flows.tracked import Tracking
from juicer.artifacts.ref import ArtifactRef
from stages.session import Session, perform_here
from stages.stage import StageCall
from stages.tracking.courier import Courier, Destination

DELIVERY_SECONDS = 60.0
"""How long the end of a run may wait for MLflow."""

Performer = Callable[[StageCall, Session], ArtifactRef]
Sender = Callable[[StageCall, Session], None]


@dataclass(frozen=True)
class Opened:
    """A run's surroundings.

    Attributes:
        session: What its stages share.
        board: Where its progress shows.
        tracking: Its records; none if nothing is tracked.
    """

    session: Session
    board: Board
    tracking: Tracking | None


@contextmanager
def opened(
    settings: Settings,
    config: RunConfig | None,
    perform: Performer = perform_here,
    *,
    send: Sender | None = None,
    forced: frozenset[str] = frozenset(),
) -> Iterator[Opened]:
    """Everything a run needs, for the length of a block; what was recorded is delivered at its end.

    Args:
        settings: Facts about this machine.
        config: The run to be recorded; none records nothing.
        perform: How stage calls are run.
        send: Has them run on another machine.
        forced: Stages that are recomputed even if their artifact is in the store.
    """
    store = open_store(settings)
    with Board(workers=settings.workers) as board:
        session = Session(
            store,
            display=board,
            perform=perform,
            workers=settings.workers,
            num_envs=settings.num_envs,
            device=settings.device,
            isolate=True,
            send=send,
            forced=forced,
        )
        if config is None or not settings.tracks:
            yield Opened(session, board, None)
            return
        place = destination(settings)
        journals = place.folder(settings.folder / "tracking")
        courier = Courier(journals, place, store, board.say)
        tracking = Tracking(journals, config)
        courier.start()
        patience = 0.0  # an interrupt is not made to wait
        try:
            yield Opened(session, board, tracking)
            patience = DELIVERY_SECONDS
        except Exception:
            patience = DELIVERY_SECONDS
            raise
        finally:
            if not courier.finish(patience) and patience:
                board.say("MLflow has not taken all records yet; the next run delivers the rest")


def expect(opened: Opened, planned: list[PlannedCall]) -> None:
    """Tell the progress lines what is to come, and how long it took before."""
    seconds = {
        manifest.recipe.stage: manifest.seconds
        for manifest in opened.session.store.list()
        if manifest.recipe.stage in {entry.stage for entry in planned}
    }
    opened.board.expect([(entry.stage, entry.label) for entry in planned if not entry.exists], seconds)


def destination(settings: Settings) -> Destination:
    """Where the records go."""
    if settings.tracking_uri:
        return Destination(settings.tracking_uri)
    return Destination(sqlite_address("sqlite", settings.folder / "mlflow.db"), settings.folder / "mlflow-files")
