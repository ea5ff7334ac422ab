"""Records of conditions and of their models, as journals; the counterpart of MLflow's parent and child runs."""

from __future__ import annotations

import hashlib
import logging
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from juicer.artifacts.ref import ArtifactRef
from juicer.config import canonical_json
from juicer.progress import MetricSink
from stages.tracking.journal import END, FINISHED, MADE, METRICS, RESULT, RESUMED, RUN, Journal

logger = logging.getLogger(__name__)

DATA_KINDS = ("logs", "episodes", "columns", "annotations", "selection", "dataset")
"""Kinds that appear as datasets; a condition's run shows those of all its models."""


@dataclass(frozen=True)
class RunDescription:
    """What a tracked run is.

    Attributes:
        experiment: Name of the experiment.
        name: Name of the run.
        identity: What makes it the same run when it is started again: configuration and code.
        params: Configuration, flat.
        tags: Further facts.
    """

    experiment: str
    name: str
    identity: Mapping[str, Any]
    params: Mapping[str, Any]
    tags: Mapping[str, str]

    def key(self, parent: str | None) -> str:
        """Name of its journal."""
        content = {"experiment": self.experiment, "name": self.name, "parent": parent, "identity": self.identity}
        return hashlib.sha256(canonical_json(content).encode()).hexdigest()[:16]


class RunRecord:
    """Record of one run. A run that is started again continues its record; what is known is not repeated.

    Attributes:
        journal: Where it is written.
        status: How the run ended; none while it goes on.
    """

    def __init__(self, folder: Path, description: RunDescription, parent: RunRecord | None = None) -> None:
        """Open or continue the record below ``folder``."""
        self._parent = parent
        self._lock = threading.Lock()
        self.journal: Journal = Journal(folder, description.key(parent.journal.key if parent else None))
        self._attempt(self.journal.begin)
        entries = [entry.content for entry in self.journal.entries()]
        self._known = {(entry["ref"], entry["stage"]) for entry in entries if entry["event"] == MADE}
        self.status = next((entry["status"] for entry in reversed(entries) if entry["event"] == END), None)
        if not any(entry["event"] == RUN for entry in entries):
            self._write(
                RUN,
                parent=parent.journal.key if parent else None,
                experiment=description.experiment,
                name=description.name,
                params=dict(description.params),
                tags=dict(description.tags),
            )

    def made(self, ref: ArtifactRef, stage: str, prefix: str, *, live: bool = False) -> None:
        """Note an artifact, once; ``live`` tells that its curves were noted while it was made."""
        if (str(ref), stage) not in self._known:
            self._known.add((str(ref), stage))
            self._write(MADE, ref=str(ref), stage=stage, prefix=prefix, live=live)
        if self._parent and ref.kind in DATA_KINDS:
            self._parent.made(ref, stage, "")

    def measured(self, metrics: Mapping[str, float], step: int) -> None:
        """Note numbers of a curve."""
        self._write(METRICS, metrics=dict(metrics), step=step)

    def result(self, metrics: Mapping[str, float], table: str = "") -> None:
        """Note final numbers, and a table in Markdown."""
        if self.status != FINISHED:
            self._write(RESULT, metrics=dict(metrics), table=table)

    def close(self, status: str) -> None:
        """The run is over."""
        if self.status != status:
            self._write(END, status=status)
        self._attempt(self.journal.finish)

    def _write(self, event: str, **content: Any) -> None:
        with self._lock:
            if self.status and event != END:
                self._attempt(lambda: self.journal.append(RESUMED))
            self.status = content.get("status")
            self._attempt(lambda: self.journal.append(event, **content))

    @staticmethod
    def _attempt(action: Any) -> None:
        # An experiment goes on even if nobody can write it down.
        try:
            action()
        except OSError as error:
            logger.warning("the tracking journal cannot be written: %s", error)


class ModelRecord:
    """What a session of stages tells its run; after the first training, names of numbers begin with the turn."""

    def __init__(self, run: RunRecord, prefix: str = "") -> None:
        self._run = run
        self._prefix = prefix
        self._live: set[str] = set()

    def metrics(self, stage: str) -> MetricSink:
        """Curves go to the run."""
        self._live.add(stage)
        return _Curve(self._run, self._prefix)

    def for_round(self, turn: int) -> ModelRecord:
        """The record of one turn of collect, select, train."""
        return ModelRecord(self._run, f"round_{turn}/")

    def made(self, ref: ArtifactRef, stage: str) -> None:
        """The run has an artifact."""
        self._run.made(ref, stage, self._prefix, live=stage in self._live)


class _Curve:
    def __init__(self, run: RunRecord, prefix: str) -> None:
        self._run = run
        self._prefix = prefix

    def log(self, metrics: Mapping[str, float], step: int) -> None:
        self._run.measured({f"{self._prefix}{name}": value for name, value in metrics.items()}, step)
