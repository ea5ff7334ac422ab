"""A study as a page of Markdown, with its drawings beside it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from urllib.parse import quote

from juicer.reporting.section import Section, Table
from juicer.text import printable


def write_markdown(path: Path, title: str, facts: Mapping[str, str], sections: Sequence[Section]) -> list[Path]:
    """Write the page, and its drawings into a folder named like it.

    Args:
        path: Where the page goes.
        title: Its heading.
        facts: What it was made of, by name.
        sections: What it says.

    Returns:
        Every file written, the page first.
    """
    folder = path.with_suffix("")
    charts = [chart for section in sections for chart in section.charts]
    if charts:
        folder.mkdir(exist_ok=True)
    drawings = []
    for chart in charts:
        drawings.append(folder / f"{chart.name}.png")
        drawings[-1].write_bytes(chart.png)
    path.write_text("\n".join(_lines(title, facts, sections, folder.name)), encoding="utf-8")
    return [path, *drawings]


def _lines(title: str, facts: Mapping[str, str], sections: Sequence[Section], folder: str) -> Iterator[str]:
    yield f"# {_cell(title)}\n"
    yield from _table(Table(("", ""), tuple(facts.items()), words=2))
    for section in sections:
        yield f"## {_cell(section.title)}\n"
        if section.note:
            yield f"{_cell(section.note)}\n"
        for chart in section.charts:
            yield f"![{_cell(chart.title)}]({quote(f'{folder}/{chart.name}.png')})\n"
            yield f"{_cell(chart.title)}. {_cell(chart.note)}\n"
        for table in section.tables:
            if table.title:
                yield f"### {_cell(table.title)}\n"
            yield from _table(table)
            if table.note:
                yield f"{_cell(table.note)}\n"


def _table(table: Table) -> Iterator[str]:
    yield _row(table.columns)
    yield _row(["---" if place < table.words else "---:" for place, _ in enumerate(table.columns)])
    yield from map(_row, table.rows)
    yield ""


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(map(_cell, cells))} |"


def _cell(text: str) -> str:
    """A text that Markdown does not take for more than a text."""
    shown = printable(text, 2000)
    for sign in ("\\", "|", "<", "*", "_", "`", "["):
        shown = shown.replace(sign, f"\\{sign}")
    return shown
