"""A section of a report as plain data: text, tables and figures, for a web page and for Markdown alike."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Table:
    """Rows of texts.

    Attributes:
        columns: Headings.
        rows: Cells, as many a row as there are headings.
        title: What it shows, if a section has several.
        note: What a reader must know to read it.
        words: Columns, from the first, that hold words; the others hold numbers.
        folded: Whether a web page shows it only when asked to, by its title.
    """

    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    title: str = ""
    note: str = ""
    words: int = 1
    folded: bool = False


@dataclass(frozen=True)
class Chart:
    """A drawing.

    Attributes:
        name: File name without its ending.
        title: What it shows.
        svg: For the page, in whose colours it is drawn.
        png: For everywhere else.
        note: What a reader must know to read it.
    """

    name: str
    title: str
    svg: str
    png: bytes
    note: str = ""


@dataclass(frozen=True)
class Section:
    """A part of a report that can be read by itself.

    Attributes:
        anchor: By which links find it.
        short: Its name in a list of sections.
        title: Its heading.
        note: What all of it has in common.
        tables: In order, after the charts.
        charts: In order.
    """

    anchor: str
    short: str
    title: str
    note: str = ""
    tables: tuple[Table, ...] = ()
    charts: tuple[Chart, ...] = ()
