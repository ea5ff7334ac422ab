"""Brings together what a run needs: the store, the progress lines, the records."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from urllib.parse import urlsplit

from flows.config import RunConfig
from flows.running.data_folder import open_store, sqlite_address
from flows.running.plan import PlannedCall
from flows.running.services import find_pages, find_services
from flows.running.settings import Settings
from flows.running.tracking import Tracking
from flows.terminal.progress import Board
from flows.terminal.time_left import Call
from juicer.artifacts.catalog import catalog_of, kind_of_work
from stages.runtime.execution import perform_here
from stages.runtime.session import Performer, Session
from stages.tracking.destination import Destination, runs_page, without_credentials
from stages.tracking.recorder import Recorder

PUBLISHING_SECONDS = 60.0
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
    """Everything a run needs, for the length of a block; MLflow shows it meanwhile and at its end.

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
        recorder = Recorder(destination(settings), store, board.say, partial(find_pages, settings.folder))
        recorder.start()
        # An interrupt is not made to wait.
        patience, status = 0.0, "KILLED"
        try:
            yield RunContext(session, board, Tracking(recorder, config))
            patience, status = PUBLISHING_SECONDS, "FINISHED"
        except Exception:
            patience, status = PUBLISHING_SECONDS, "FAILED"
            raise
        finally:
            if not recorder.finish(patience, status) and patience:
                board.say("MLflow does not show everything yet; the next run, of whatever, sees to the rest")
            if page := records_page(settings, recorder.experiments.get(config.name)):
                board.say(f"MLflow shows it at {page}")


def expect(context: RunContext, planned: list[PlannedCall], folder: Path) -> None:
    """Tell the progress lines what is to come, and how long the like of it took before.

    Args:
        context: The run.
        planned: Its stage calls.
        folder: Where the catalog of the store is kept.
    """
    to_come = [entry for entry in planned if not entry.exists]
    kinds = {entry.call.recipe.kind for entry in to_come}
    catalog = catalog_of(context.session.store, folder)
    # The newest come first in a catalog, and the last one of a kind of work is to count.
    known = (catalog.whole(kind, trusts_unstamped=True).entries for kind in kinds)
    seconds = {entry.work: entry.seconds for entries in known for entry in reversed(entries)}
    context.board.expect(
        {
            str(entry.ref): Call(entry.stage, entry.label, seconds.get(kind_of_work(entry.call.recipe)))
            for entry in to_come
        }
    )


def records_page(settings: Settings, experiment: str | None) -> str:
    """Address that opens on the runs of an experiment; empty if nobody serves MLflow's pages."""
    services = find_services(settings.folder)
    pages = settings.tracking_uri or (services.mlflow if services else "")
    if experiment is None or urlsplit(pages).scheme not in ("http", "https"):
        return ""
    return runs_page(without_credentials(pages), experiment)


def destination(settings: Settings) -> Destination:
    """Where the records go."""
    folder = settings.folder / "tracking"
    if settings.tracking_uri:
        return Destination.of(settings.tracking_uri, folder)
    # Named without the place of the data folder, which may be moved.
    uri = sqlite_address("sqlite", settings.folder / "mlflow.db")
    return Destination(uri, folder / "here", settings.folder / "mlflow-files")
