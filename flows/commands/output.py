"""How commands answer: tables and sentences for people, JSON for machines, both on standard output."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import typer


def say(text: str) -> None:
    """Print a line."""
    typer.echo(text)


def say_json(content: Any) -> None:
    """Print JSON."""
    say(json.dumps(content, indent=1, default=str))


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
