"""The yield of an augmentation: how many attempts were kept, why others were not, and what the snippets cover."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from typing import Any

from juicer.augmentation.augment import FailedAttempt, Snippet
from juicer.augmentation.config import AugmentationConfig
from juicer.episode import Episode

SIDEWAYS_EDGES_MM = (0, 2, 5, 10, 20, 50, 100, 200, 500)
ABOVE_EDGES_MM = (-50, 0, 5, 10, 20, 50, 100, 200, 500)
TURNED_EDGES_DEG = (0, 2, 5, 10, 20, 45, 90, 180)


class AugmentationSummary:
    """Counts attempts as they pass by."""

    def __init__(self, critical_states: Sequence[str]) -> None:
        """Start with nothing counted.

        Args:
            critical_states: Names of the task's critical states, in order.
        """
        self._critical_states = critical_states
        self._tried: Counter[str] = Counter()
        self._kept: Counter[str] = Counter()
        self._tried_at: Counter[int] = Counter()
        self._kept_at: Counter[int] = Counter()
        self._parents: Counter[str | None] = Counter()
        self._rejections: Counter[str] = Counter()
        self._lengths: list[int] = []
        self._sideways_mm: list[float] = []
        self._above_mm: list[float] = []
        self._turned_deg: list[float] = []

    def keep(self, attempts: Iterable[Snippet | FailedAttempt]) -> Iterator[Episode]:
        """Count every attempt and yield the episodes of those that were kept."""
        for attempt in attempts:
            self._tried[attempt.departure] += 1
            self._tried_at[attempt.critical_state] += 1
            if isinstance(attempt, FailedAttempt):
                self._rejections[attempt.reason] += 1
                continue
            self._kept[attempt.departure] += 1
            self._kept_at[attempt.critical_state] += 1
            self._parents[attempt.episode.record.parent] += 1
            self._lengths.append(len(attempt.episode))
            sideways_m, above_m, turned_rad = attempt.start
            self._sideways_mm.append(1e3 * sideways_m)
            self._above_mm.append(1e3 * above_m)
            self._turned_deg.append(math.degrees(turned_rad))
            yield attempt.episode

    def why_nothing(self, config: AugmentationConfig) -> str:
        """In a sentence, why no attempt was kept; empty if one was."""
        if self._kept.total():
            return ""
        if not self._tried.total():
            return (
                "no corrective episode: no critical state of a successful demonstration can be augmented; "
                f"label some by hand, or lower augment.min_confidence (now {config.min_confidence})"
            )
        reason, count = self._rejections.most_common(1)[0]
        return (
            f"no corrective episode: none of {self._tried.total()} attempts succeeded, {count} ended with "
            f"'{reason}'; look at the ranges in {_ranges(config)} and at augment.tolerance"
        )

    def as_json(self) -> dict[str, Any]:
        """Facts for an artifact's manifest: counts, the yield, rejection reasons, and histograms of the starts."""
        attempts, kept = self._tried.total(), self._kept.total()
        return {
            "attempts": attempts,
            "snippets": kept,
            "yield": kept / attempts if attempts else 0.0,
            "steps": sum(self._lengths),
            "mean_length": sum(self._lengths) / kept if kept else 0.0,
            "demonstrations_used": len(self._parents),
            "rejections": {str(reason): n for reason, n in self._rejections.most_common()},
            "by_critical_state": {
                self._critical_states[state]: {"attempts": tried, "snippets": self._kept_at[state]}
                for state, tried in sorted(self._tried_at.items())
            },
            "by_departure": {
                kind: {"attempts": tried, "snippets": self._kept[kind]} for kind, tried in sorted(self._tried.items())
            },
            "start_sideways_mm": histogram(self._sideways_mm, SIDEWAYS_EDGES_MM),
            "start_above_mm": histogram(self._above_mm, ABOVE_EDGES_MM),
            "start_turned_deg": histogram(self._turned_deg, TURNED_EDGES_DEG),
        }


def _ranges(config: AugmentationConfig) -> str:
    """Settings that say how far attempts leave the demonstration."""
    return "augment.departures" if config.grasp is None else "augment.departures and augment.grasp"


def histogram(values: Sequence[float], edges: Sequence[int]) -> dict[str, int]:
    """Number of values in each bin ``low..high`` (upper edge excluded); values outside count in the nearest bin."""
    counts = {f"{low}..{high}": 0 for low, high in pairwise(edges)}
    labels = list(counts)
    for value in values:
        place = sum(value >= edge for edge in edges[1:-1])
        counts[labels[place]] += 1
    return counts
