"""What other packages announce to juicer: entry points of their distributions, by group and name."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from juicer.errors import ConfigError
from juicer.text import printable


def announced(group: str) -> dict[str, EntryPoint]:
    """Entry points of a group by name, sorted; nothing of them is imported."""
    found: Iterable[EntryPoint] = _every_one().select(group=group)
    return {entry.name: entry for entry in sorted(found, key=lambda entry: entry.name)}


def origin_of(entry: EntryPoint) -> str:
    """Where an entry point leads and who announced it, for a message."""
    owner = entry.dist.name if entry.dist else "an unknown package"
    return f"'{printable(entry.value)}' of package '{printable(owner)}'"


def load(entry: EntryPoint, noun: str, problem_of: Callable[[Any], str]) -> Any:
    """What an entry point leads to.

    Args:
        entry: Found by :func:`announced`.
        noun: What it should be, for a message.
        problem_of: What is wrong with what was found, as a clause; empty if nothing is.

    Raises:
        ConfigError: If it cannot be imported, or something is wrong with it.
    """
    try:
        found = entry.load()
        problem = problem_of(found)
    except Exception as error:  # whatever somebody else's module may raise
        problem = f"{type(error).__name__}: {error}"
    if problem:
        raise ConfigError(
            f"{noun} '{printable(entry.name)}', which is {origin_of(entry)}, cannot be used: "
            f"{printable(problem, 500)}; mend it, or uninstall that package"
        )
    return found


@cache
def _every_one() -> Any:  # its type is another one in Python 3.11 and later
    # All at once: for a single group, the announcements of every distribution are read too.
    return entry_points()
