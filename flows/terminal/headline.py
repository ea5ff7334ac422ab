"""The facts about an artifact that fit on a line."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from juicer.artifacts.manifest import headline_of
from juicer.text import printable

_REJECTIONS_SHOWN = 20
_LONGEST = 2000


def headline(summary: Mapping[str, Any]) -> str:
    """What a summary says, in a few words: what its stage found worth saying, or why it failed."""
    return printable(summary.get("reason", headline_of(summary)), _LONGEST)


def rejections(summary: Mapping[str, Any]) -> list[str]:
    """Why operator logs became no demonstrations, a line each."""
    # An augmentation counts its rejections instead.
    reasons = {log: reason for log, reason in summary.get("rejections", {}).items() if isinstance(reason, str)}
    lines = [f"{log}: {reason}" for log, reason in reasons.items()]
    # A summary repeats only so many reasons, but counts all.
    more = summary.get("rejected", len(lines)) - _REJECTIONS_SHOWN
    return [*lines[:_REJECTIONS_SHOWN], f"and {more} more; see `juicer show`"] if more > 0 else lines


def duration(seconds: float) -> str:
    """Minutes and seconds, e.g. ``0:04``; with hours if there are any."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"
