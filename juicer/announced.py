"""What other packages announce to juicer: entry points of their distributions, by group and name."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from juicer.text import printable


def announced(group: str) -> dict[str, EntryPoint]:
    """Entry points of a group by name, sorted; nothing of them is imported."""
    found: Iterable[EntryPoint] = _every_one().select(group=group)
    return {entry.name: entry for entry in sorted(found, key=lambda entry: entry.name)}


def origin_of(entry: EntryPoint) -> str:
    """Where an entry point leads and who announced it, for a message."""
    owner = entry.dist.name if entry.dist else "an unknown package"
    return f"'{printable(entry.value)}' of package '{printable(owner)}'"


@cache
def _every_one() -> Any:  # its type is another one in Python 3.11 and later
    # All at once: for a single group, the announcements of every distribution are read too.
    return entry_points()
