"""Delivers journals in the background, for as long as it takes."""

from __future__ import annotations

import hashlib
import logging
import socket
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from filelock import FileLock, Timeout

from juicer.artifacts.store import ArtifactStore
from juicer.errors import TrackingError
from stages.tracking.journal import RUN, DeliveryState, Entry, Journal, journals

if TYPE_CHECKING:
    from stages.tracking.delivery import Delivery

logger = logging.getLogger(__name__)

ROUND_SECONDS = 5.0
RETRY_SECONDS = 30.0
CONNECT_SECONDS = 5.0
LOCK = "courier.lock"
"""One courier at a time, which also keeps a new database from being initialised twice at once."""


@dataclass(frozen=True)
class Destination:
    """Where journals are delivered to.

    Attributes:
        uri: MLflow tracking address.
        artifact_root: Where the files of new experiments go; the server decides if None.
    """

    uri: str
    artifact_root: Path | None = None

    def folder(self, below: Path) -> Path:
        """Where the journals meant for it are; another destination must not get them."""
        return below / hashlib.sha256(self.uri.encode()).hexdigest()[:8]

    def check(self) -> None:
        """Make a connection, if it is a server.

        Raises:
            OSError: If none can be made.
        """
        parts = urlsplit(self.uri)
        if parts.scheme in ("http", "https"):
            port = parts.port or (443 if parts.scheme == "https" else 80)
            socket.create_connection((parts.hostname or "", port), timeout=CONNECT_SECONDS).close()


def initialise(folder: Path, destination: Destination) -> None:
    """Create the tables of a tracking database, one process at a time.

    Raises:
        TrackingError: If the database cannot be used.
    """
    from stages.tracking.delivery import Delivery

    try:
        folder.mkdir(parents=True, exist_ok=True)
        with FileLock(folder / LOCK):
            Delivery(destination.uri, destination.artifact_root, ArtifactStore(folder)).ping()
    except Exception as error:
        raise TrackingError(f"MLflow at '{destination.uri}' cannot be used: {_reason(error)}") from None


class Courier:
    """A thread that delivers whatever the journals of a folder hold that was not delivered before."""

    def __init__(
        self, folder: Path, destination: Destination, store: ArtifactStore, warn: Callable[[str], None]
    ) -> None:
        """Prepare; nothing is touched before :meth:`start`.

        Args:
            folder: Where the journals are, those meant for the destination.
            destination: Where they are delivered to.
            store: Where the artifacts are that they name.
            warn: Told, once, if MLflow cannot be used.
        """
        self._folder = folder
        self._destination = destination
        self._store = store
        self._warn = warn
        self._warned = False
        self._delivery: Delivery | None = None
        self._finish = threading.Event()
        self._thread = threading.Thread(target=self._work, name="tracking courier", daemon=True)

    def start(self) -> None:
        """Begin to deliver, first of all that killed runs were killed."""
        for journal in journals(self._folder):
            journal.bury()
        self._thread.start()

    def finish(self, patience_s: float) -> bool:
        """Deliver what is left, for at most so long; returns whether all was delivered."""
        self._finish.set()
        self._thread.join(patience_s)
        return not self._thread.is_alive() and not self.pending()

    def pending(self) -> bool:
        """Whether a journal holds events that were not delivered."""
        return any(
            journal.path.stat().st_size > DeliveryState.load(journal).offset for journal in journals(self._folder)
        )

    def _work(self) -> None:
        while True:
            last = self._finish.is_set()
            delivered = self._round()
            if last:
                return
            self._finish.wait(ROUND_SECONDS if delivered else RETRY_SECONDS)

    def _round(self) -> bool:
        """Deliver once around; returns whether MLflow could be used."""
        if not self.pending():
            return True
        try:
            with FileLock(self._folder / LOCK).acquire(timeout=ROUND_SECONDS):
                self._deliver_all(self._connected())
        except Timeout:
            return True
        except Exception as error:
            if not self._warned:
                self._warned = True
                self._warn(_sentence(self._destination.uri, error, self._folder))
            logger.debug("delivery failed", exc_info=error)
            return False
        return True

    def _connected(self) -> Delivery:
        self._destination.check()
        if self._delivery is None:
            from stages.tracking.delivery import Delivery

            delivery = Delivery(self._destination.uri, self._destination.artifact_root, self._store)
            delivery.ping()
            self._delivery = delivery
        return self._delivery

    def _deliver_all(self, delivery: Delivery) -> None:
        waiting = [(journal, journal.entries()) for journal in journals(self._folder)]
        # Parents come first: their children refer to them.
        waiting.sort(key=lambda pair: _parent_of(pair[1]) is not None)
        for journal, entries in waiting:
            self._deliver_one(delivery, journal, entries)

    def _deliver_one(self, delivery: Delivery, journal: Journal, entries: list[Entry]) -> None:
        state = DeliveryState.load(journal)
        news = [entry for entry in entries if entry.end > state.offset]
        if not news:
            return
        key = _parent_of(entries)
        parent = DeliveryState.load(Journal(self._folder, key)) if key else None
        for progress in delivery.deliver(news, state, parent):
            progress.save(journal)


def _parent_of(entries: list[Entry]) -> str | None:
    return next((entry.content["parent"] for entry in entries if entry.content["event"] == RUN), None)


def _reason(error: Exception) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__


def _sentence(uri: str, error: Exception, folder: Path) -> str:
    return (
        f"MLflow at '{uri}' cannot be used ({_reason(error)}); the run goes on, and its records wait in '{folder}' "
        "until the next run finds it well"
    )
