"""How long-running library code reports what it is doing, without knowing who listens."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol


class Progress(Protocol):
    """Listener for the advance of one piece of work."""

    def __call__(self, done: int, total: int, **facts: float | str) -> None:
        """Report that ``done`` of ``total`` units are finished, with facts worth showing."""
        ...


class MetricSink(Protocol):
    """Listener for numbers that form curves."""

    def log(self, metrics: Mapping[str, float], step: int) -> None:
        """Record metrics at a step."""
        ...


def silent_progress(done: int, total: int, **facts: float | str) -> None:
    """Progress listener that listens to nothing."""


class NullMetricSink:
    """Metric sink that keeps nothing."""

    def log(self, metrics: Mapping[str, float], step: int) -> None:
        """Drop the metrics."""
