"""Brings together what a run needs: the store, the progress lines, the records and their delivery."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from flows.config import RunConfig
from flows.running.data_folder import open_store, sqlite_address
from flows.running.plan import PlannedCall
from flows.running.settings import Settings
from flows.running.tracking import Tracking
from flows.terminal.progress import Board
from juicer.artifacts.recipe import Recipe
from juicer.config import canonical_json
from stages.runtime.execution import perform_here
from stages.runtime.session import Performer, Session
from stages.tracking.courier import Courier, Destination

DELIVERY_SECONDS = 60.0
"""How long the end of a run may wait for MLflow."""


@dataclass(frozen=True)
class RunContext:
    """What a run is given.

    Attributes:
        session: What its stages share.
        board: Where its progress shows.
        tracking: Its records; none if nothing is tracked.
    """

    session: Session
    board: Board
    tracking: Tracking | None


@contextmanager
def open_run(
    settings: Settings,
    config: RunConfig | None,
    performer: Performer = perform_here,
    *,
    forced: frozenset[str] = frozenset(),
) -> Iterator[RunContext]:
    """Everything a run needs, for the length of a block; what was recorded is delivered at its end.

    Args:
        settings: Facts about this machine.
        config: The run to be recorded; none records nothing.
        performer: How stage calls are run.
        forced: Stages that are recomputed even if their artifact is in the store.
    """
    store = open_store(settings)
    with Board(workers=settings.workers) as board:
        session = Session(
            store,
            performer,
            display=board,
            machine=settings.machine,
            isolate=True,
            forced=forced,
        )
        if config is None or not settings.tracks:
            yield RunContext(session, board, None)
            return
        place = destination(settings)
        journals = place.folder(settings.folder / "tracking")
        courier = Courier(journals, place, store, board.say)
        tracking = Tracking(journals, config)
        courier.start()
        patience = 0.0  # an interrupt is not made to wait
        try:
            yield RunContext(session, board, tracking)
            patience = DELIVERY_SECONDS
        except Exception:
            patience = DELIVERY_SECONDS
            raise
        finally:
            if not courier.finish(patience) and patience:
                board.say("MLflow has not taken all records yet; the next run delivers the rest")


def expect(context: RunContext, planned: list[PlannedCall]) -> None:
    """Tell the progress lines what is to come, and how long the like of it took before."""
    manifests = context.session.store.list()
    seconds = {_kind_of_work(manifest.recipe): manifest.seconds for manifest in manifests}
    to_come = [entry for entry in planned if not entry.exists]
    context.board.expect(
        {(entry.stage, entry.label): seconds.get(_kind_of_work(entry.call.recipe)) for entry in to_come}
    )


def _kind_of_work(recipe: Recipe) -> str:
    """What takes about the same time: a stage with a configuration, whatever it starts from and draws."""
    content = {name: value for name, value in recipe.config.items() if name not in ("seed", "first", "rows")}
    return f"{recipe.stage} {canonical_json(content)}"


def destination(settings: Settings) -> Destination:
    """Where the records go."""
    if settings.tracking_uri:
        return Destination(settings.tracking_uri)
    return Destination(sqlite_address("sqlite", settings.folder / "mlflow.db"), settings.folder / "mlflow-files")
