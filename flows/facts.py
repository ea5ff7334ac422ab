"""The facts about an artifact that fit on a line."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from juicer.artifacts.manifest import FINDING

_CHOSEN = (
    "successes",
    "yield",
    "snippets",
    "episodes",
    "kept",
    "rejected",
    "critical_states",
    "logs",
    "steps",
    "train/loss",
    "validation/position_error_mm",
)
"""Facts worth a place, in this order, if a summary has them."""


def headline(summary: Mapping[str, Any]) -> str:
    """What a summary says, in a few words."""
    if "reason" in summary:
        return str(summary["reason"])
    if "interval_low" in summary:
        low, high = summary["interval_low"], summary["interval_high"]
        return f"success {summary['success_rate']:.0%} of {summary['episodes']} episodes ({low:.0%} to {high:.0%})"
    chosen = {name: summary[name] for name in _CHOSEN if isinstance(summary.get(name), int | float)}
    facts = ", ".join(f"{name.rpartition('/')[2].replace('_', ' ')} {number(value)}" for name, value in chosen.items())
    return "; ".join(str(part) for part in (facts, summary.get(FINDING)) if part)


def number(value: float | str) -> str:
    """Three digits of a fraction, all of a count."""
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def duration(seconds: float) -> str:
    """Minutes and seconds, e.g. ``0:04``; with hours if there are any."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"
