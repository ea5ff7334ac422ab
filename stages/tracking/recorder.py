"""Tells MLflow of a run in the background, while it goes on: curves as they grow, models as they are finished.

One thread does all that waits for MLflow, so that a server that is away, or does not answer, costs a run nothing. It is
not MLflow's own queue, for which the interpreter waits at its end, however long a server is silent.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING

from filelock import FileLock, Timeout

from juicer.artifacts.store import ArtifactStore
from stages.tracking.destination import Destination, reason
from stages.tracking.model import Model, noted

if TYPE_CHECKING:
    from mlflow import MlflowClient
    from mlflow.entities import Metric

logger = logging.getLogger(__name__)

ROUND_SECONDS = 5.0
LIVE = ".live"
"""Suffix of files that are locked as long as the process lives which goes on with an MLflow run."""


class Recorder:
    """A thread that publishes what is noted for a destination, first of all what earlier runs had to leave."""

    def __init__(
        self,
        destination: Destination,
        store: ArtifactStore,
        warn: Callable[[str], None],
        pages: Callable[[], str] = lambda: "",
    ) -> None:
        """Prepare; nothing is touched before :meth:`start`.

        Args:
            destination: Where records go.
            store: Where the artifacts are.
            warn: Told what MLflow does not show, each sentence once.
            pages: Gives the address of juicer's pages, to which records link; empty if they are not served.
        """
        self.experiments: dict[str, str] = {}
        self._destination = destination
        self._store = store
        self._warn = warn
        self._pages = pages
        self._said: set[str] = set()
        self._shown: dict[str, tuple[object, ...]] = {}
        self._points: SimpleQueue[tuple[Model, dict[str, float], int, float]] = SimpleQueue()
        self._live: dict[str, tuple[str, FileLock, int]] = {}
        self._is_due, self._finish = True, threading.Event()
        self._status = "FINISHED"
        self._thread = threading.Thread(target=self._work, name="MLflow", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def log(self, model: Model, metrics: Mapping[str, float], step: int) -> None:
        """Show numbers of a model that is being made; they are told again by its artifacts in the end."""
        self._points.put((model, dict(metrics), step, time.time()))

    def note(self, model: Model) -> None:
        """Have a finished model published, now or by a later run."""
        try:
            model.note(self._destination.folder)
        except OSError as error:
            self._say(f"{model.label} cannot be noted for MLflow in '{self._destination.folder}': {reason(error)}")
        self._is_due = True

    def finish(self, patience_s: float, status: str) -> bool:
        """Publish what is left, for at most so long.

        Args:
            patience_s: How long to wait.
            status: How models end that are not finished.

        Returns:
            Whether MLflow shows everything.
        """
        self._status = status
        self._finish.set()
        self._thread.join(patience_s)
        return not self._thread.is_alive() and not self._is_due

    def _work(self) -> None:
        is_last = False
        while not is_last:
            is_last = self._finish.wait(ROUND_SECONDS)
            try:
                self._round(is_last)
            except Exception as error:
                logger.debug("MLflow was not told", exc_info=error)
                self._say(
                    f"MLflow at '{self._destination.shown}' cannot be used ({reason(error)}); the run goes on, and a "
                    "later one records what this one makes"
                )

    def _round(self, is_last: bool) -> None:
        if not (self._is_due or is_last or not self._points.empty()):
            return
        with self._destination.lock:
            client = self._destination.connect()
        self._show_points(client)
        if self._is_due:
            self._publish(client)
        if is_last:
            for run, lock, _ in self._live.values():
                _end(client, run, self._status)
                _release(lock)

    def _publish(self, client: MlflowClient) -> None:
        from stages.tracking.publish import publish

        folder = self._destination.folder
        with self._destination.lock:
            _bury(client, folder)
            self._is_due = False
            pages, models = self._pages(), noted(folder)
            states = _states(models, pages)
            # Of all studies that were ever recorded, those of which there is something new.
            new = [model for model in models if self._shown.get(model.study) != states[model.study]]
            try:
                published = publish(client, self._store, new, self._destination.artifact_root, pages)
            except Exception:
                self._is_due = True
                raise
            self._shown = states
        self.experiments |= published.experiments
        for problem in published.problems:
            self._say(problem)
        for model in models:
            # What was noted before is the model in whose place this one is trained.
            if model.key in self._live and 1000 * model.noted >= self._live[model.key][2]:
                _release(self._live.pop(model.key)[1])

    def _show_points(self, client: MlflowClient) -> None:
        from mlflow.entities import Metric

        waiting: dict[str, tuple[Model, list[Metric]]] = {}
        while True:
            try:
                model, metrics, step, moment = self._points.get_nowait()
            except Empty:
                break
            points = waiting.setdefault(model.key, (model, []))[1]
            points += [Metric(name, value, int(1000 * moment), step) for name, value in metrics.items()]
        for model, points in waiting.values():
            try:
                run = self._run_of(client, model, min(point.timestamp for point in points))
                for start in range(0, len(points), 1000):
                    client.log_batch(run, points[start : start + 1000])
            except Exception as error:
                client.search_experiments(max_results=1)  # raises if MLflow is away
                logger.debug("no curves of %s are shown", model.label, exc_info=error)

    def _run_of(self, client: MlflowClient, model: Model, moment: int) -> str:
        """The run of a model that is being made at a moment; what an earlier process began is gone on with."""
        if model.key not in self._live:
            from stages.tracking.publish import Study

            study = Study(client, self._store, model.study, self._destination.artifact_root)
            run = study.open_to_train(model, moment).info.run_id
            lock = FileLock(self._destination.folder / f"{run}{LIVE}")
            lock.acquire(timeout=0)
            client.update_run(run, status="RUNNING")
            self._live[model.key] = (run, lock, moment)
            self.experiments[model.study] = study.experiment
        return self._live[model.key][0]

    def _say(self, sentence: str) -> None:
        if sentence not in self._said:
            self._said.add(sentence)
            self._warn(sentence)


def _states(models: Iterable[Model], pages: str) -> dict[str, tuple[object, ...]]:
    """By study, what tells whether it was shown already as it is noted now."""
    studies: dict[str, list[object]] = {}
    for model in models:
        studies.setdefault(model.study, [pages]).append((model.key, model.noted))
    return {study: tuple(state) for study, state in studies.items()}


def _bury(client: MlflowClient, folder: Path) -> None:
    """Mark runs as killed whose process is gone without having said so."""
    for path in folder.glob(f"*{LIVE}"):
        lock = FileLock(path)
        try:
            lock.acquire(timeout=0)
        except (Timeout, OSError):
            continue
        _end(client, path.name.removesuffix(LIVE), "KILLED")
        _release(lock)


def _end(client: MlflowClient, run: str, status: str) -> None:
    from mlflow.exceptions import MlflowException

    try:
        if client.get_run(run).info.status == "RUNNING":
            client.set_terminated(run, status)
    except MlflowException as error:
        # It was deleted; or MLflow is away, and the run is shown as running until it is made again.
        logger.debug("run %s cannot be ended", run, exc_info=error)


def _release(lock: FileLock) -> None:
    Path(lock.lock_file).unlink(missing_ok=True)
    lock.release()
