"""Long lists, a part on each page; and what their addresses may hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, TypeVar
from urllib.parse import urlencode

from fastapi import Query
from starlette.requests import Request

ItemT = TypeVar("ItemT")

LINES = 100
"""Of a list on one page."""

Word = Annotated[str, Query(max_length=200)]
Number = Annotated[int, Query(ge=0, le=10**9)]


@dataclass(frozen=True)
class Part:
    """Some lines of a list.

    Attributes:
        lines: The lines.
        total: How many the list has.
        first: Which one is the first of these.
        previous: Address of those before, or behind the end of the list, of the last ones; empty if there are none.
        following: Address of those after.
    """

    lines: Sequence[Any]
    total: int
    first: int
    previous: str
    following: str


def part_of(request: Request, lines: Sequence[ItemT], first: int) -> Part:
    """The lines of a list from one on, as many as a page shows."""

    def address(start: int) -> str:
        return f"{request.url.path}?{urlencode({**request.query_params, 'first': start})}"

    end = first + LINES
    before = min(first - LINES, (len(lines) - 1) // LINES * LINES)
    return Part(
        lines[first:end],
        len(lines),
        first,
        previous=address(max(0, before)) if first and lines else "",
        following=address(end) if end < len(lines) else "",
    )
