"""How commands answer: tables and sentences for people, JSON for machines, both on standard output."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import typer

from juicer.text import printable

LONGEST_MESSAGE = 10_000


def say(text: str) -> None:
    """Print a line."""
    typer.echo(text)


def say_json(content: Any) -> None:
    """Print JSON."""
    say(json.dumps(content, indent=1, default=str))


def say_error(message: str, kind: str, as_json: bool) -> None:
    """Print why a command failed: for people to standard error, for machines as JSON to standard output."""
    # Whatever a message repeats of foreign files and arguments must not steer the terminal.
    shown = printable(message, LONGEST_MESSAGE)
    if as_json:
        say_json({"error": shown, "kind": kind})
    elif shown:  # without arguments, help was shown
        typer.echo(f"juicer: {shown}", err=True)


def say_table(columns: Sequence[str], rows: Sequence[Sequence[str]], title: str | None = None) -> None:
    """Print a table; a column whose name ends in a space is aligned to the right."""
    if title:
        say(title)
    names = [column.strip() for column in columns]
    widths = [max(map(len, cells)) for cells in zip(names, *rows, strict=True)]
    for row in (names, *rows):
        cells = [
            cell.rjust(width) if column.endswith(" ") else cell.ljust(width)
            for cell, width, column in zip(row, widths, columns, strict=True)
        ]
        say("  ".join(cells).rstrip())


def bytes_text(count: int) -> str:
    """Size for people, e.g. ``3.2 MB``."""
    size = float(count)
    for unit in ("B", "kB", "MB"):
        if size < 1000:
            return f"{size:.0f} {unit}" if unit == "B" else f"{size:.1f} {unit}"
        size /= 1000
    return f"{size:.1f} GB"
