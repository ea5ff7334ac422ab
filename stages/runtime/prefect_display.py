"""Progress and summaries of stages as artifacts of Prefect, where people and other processes read them."""

from __future__ import annotations

import logging
import re
import time
from collections.abc import Callable, Mapping
from typing import Any
from uuid import UUID

from prefect.artifacts import (
    Artifact,
    create_markdown_artifact,
    create_progress_artifact,
    update_progress_artifact,
)
from prefect.runtime import flow_run

from juicer.progress import Progress
from stages.runtime.context import Display

logger = logging.getLogger(__name__)

UPDATE_SECONDS = 5.0


class PrefectDisplay:
    """Repeats to Prefect what is shown to the user."""

    def __init__(self, inner: Display, now_and_then: Callable[[], None] = lambda: None) -> None:
        """Show in both places.

        Args:
            inner: Where it shows as well.
            now_and_then: Called as often as progress goes to Prefect.
        """
        self._inner = inner
        self._now_and_then = now_and_then
        self._progress: UUID | None = None

    def started(self, stage: str, label: str, artifact: str) -> Progress:
        """A stage begins."""
        listener = self._inner.started(stage, label, artifact)
        key = artifact_key(stage, label, "progress")
        self._progress = attempt(create_progress_artifact, progress=0.0, key=key, description=f"{stage} {label}")
        due = time.monotonic() + UPDATE_SECONDS

        def progress(done: int, total: int, **facts: float | str) -> None:
            nonlocal due
            listener(done, total, **facts)
            if time.monotonic() >= due:
                if self._progress and total:
                    attempt(update_progress_artifact, artifact_id=self._progress, progress=100.0 * done / total)
                self._now_and_then()
                due = time.monotonic() + UPDATE_SECONDS

        return progress

    def finished(self, stage: str, label: str, artifact: str, state: str, summary: Mapping[str, Any]) -> None:
        """A stage is over."""
        self._inner.finished(stage, label, artifact, state, summary)
        if self._progress and state == "done":
            attempt(update_progress_artifact, artifact_id=self._progress, progress=100.0)
        if state == "done":
            attempt(create_markdown_artifact, markdown=_table(summary), key=artifact_key(stage, label, "summary"))

    def settled(self, label: str) -> None:
        """Prefect expects nothing."""
        self._inner.settled(label)


def shown_percent(stage: str, label: str) -> float | None:
    """How far a stage of the flow run around it is, wherever it runs; none if it has not begun."""
    found = attempt(Artifact.get, key=artifact_key(stage, label, "progress"))
    if found is None or str(found.flow_run_id) != flow_run.get_id():
        return None
    return float(found.data or 0.0)


def attempt(action: Any, **arguments: Any) -> Any:
    """What Prefect shows is not worth the work it shows: if its server is away, go on."""
    try:
        return action(**arguments)
    except Exception as error:
        logger.debug("Prefect took no artifact: %s", error)
        return None


def artifact_key(*parts: str) -> str:
    """Parts joined to a name that Prefect allows for an artifact."""
    return "-".join(re.sub(r"[^a-z0-9]+", "-", part.lower()).strip("-") for part in parts if part)


def _table(summary: Mapping[str, Any]) -> str:
    rows = "\n".join(f"| {key} | {value} |" for key, value in summary.items())
    return f"| fact | value |\n| --- | --- |\n{rows}\n"
