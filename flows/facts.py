"""The facts about an artifact that fit on a line."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

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

_REJECTIONS_SHOWN = 20


def headline(summary: Mapping[str, Any]) -> str:
    """What a summary says, in a few words."""
    if "reason" in summary:
        return str(summary["reason"])
    if "interval_low" in summary:
        low, high = summary["interval_low"], summary["interval_high"]
        return f"success {summary['success_rate']:.0%} of {summary['episodes']} episodes ({low:.0%} to {high:.0%})"
    chosen = {name: summary[name] for name in _CHOSEN if isinstance(summary.get(name), int | float)}
    return ", ".join(f"{name.rpartition('/')[2].replace('_', ' ')} {number(value)}" for name, value in chosen.items())


def rejections(summary: Mapping[str, Any]) -> list[str]:
    """Why operator logs became no demonstrations, a line each."""
    reasons = [f"{log}: {reason}" for log, reason in summary.get("rejections", {}).items()]
    # A summary repeats only so many reasons, but counts all.
    more = summary.get("rejected", len(reasons)) - _REJECTIONS_SHOWN
    return [*reasons[:_REJECTIONS_SHOWN], f"and {more} more; see `juicer show`"] if more > 0 else reasons


def number(value: float | str) -> str:
    """Three digits of a fraction, all of a count."""
    return f"{value:.3g}" if isinstance(value, float) else str(value)
