"""The facts about an artifact that fit on a line."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from juicer.artifacts.manifest import FINDING
from juicer.text import printable

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
        return printable(summary["reason"])
    rates = [summary.get(name) for name in ("success_rate", "interval_low", "interval_high")]
    if all(isinstance(rate, int | float) for rate in rates):
        rate, low, high = rates
        return f"success {rate:.0%} of {printable(summary.get('episodes'))} episodes ({low:.0%} to {high:.0%})"
    chosen = {name: summary[name] for name in _CHOSEN if isinstance(summary.get(name), int | float)}
    facts = ", ".join(f"{name.rpartition('/')[2].replace('_', ' ')} {number(value)}" for name, value in chosen.items())
    return "; ".join(str(part) for part in (facts, summary.get(FINDING)) if part)


def rejections(summary: Mapping[str, Any]) -> list[str]:
    """Why operator logs became no demonstrations, a line each."""
    # An augmentation counts its rejections instead.
    told = {log: reason for log, reason in summary.get("rejections", {}).items() if isinstance(reason, str)}
    reasons = [f"{log}: {reason}" for log, reason in told.items()]
    # A summary repeats only so many reasons, but counts all.
    more = summary.get("rejected", len(reasons)) - _REJECTIONS_SHOWN
    return [*reasons[:_REJECTIONS_SHOWN], f"and {more} more; see `juicer show`"] if more > 0 else reasons


def number(value: float | str) -> str:
    """Three digits of a fraction, all of a count."""
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def duration(seconds: float) -> str:
    """Minutes and seconds, e.g. ``0:04``; with hours if there are any."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"
