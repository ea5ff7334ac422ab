"""HTML of pages from templates; every foreign text in it is escaped and printable."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from starlette.requests import Request
from starlette.responses import HTMLResponse

from juicer.text import printable

TEMPLATES = Path(__file__).with_name("templates")
LONGEST_TEXT = 20_000
"""Letters of one value that a page shows."""

NAVIGATION = {
    "/": "Artifacts",
    "/episodes": "Episodes",
    "/lineage": "Lineage",
    "/teleop": "Teleoperation",
    "/annotate": "Annotation",
}


def page(request: Request, template: str, status: int = 200, **content: Any) -> HTMLResponse:
    """A page.

    Args:
        request: What asks for it.
        template: Name of the template, which extends ``base.html``.
        status: HTTP status.
        content: What the template speaks of.
    """
    here = max((path for path in NAVIGATION if request.url.path.startswith(path)), key=len)
    text = (
        _environment()
        .get_template(template)
        .render(
            navigation=NAVIGATION,
            here=here,
            servers=request.app.state.workplace.servers(),
            **content,
        )
    )
    return HTMLResponse(text, status, {"Cache-Control": "no-store"})


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=_shown,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["begun"] = _begun
    return environment


def _begun(clause: str) -> str:
    """With a capital letter, unless it begins with the name of an artifact."""
    return clause if "/" in clause.partition(" ")[0] else clause[:1].upper() + clause[1:]


def _shown(value: Any) -> Any:
    """Texts with every character escaped that a page cannot show, or that turns the direction of what follows."""
    # Markup is a text as well, and made here.
    if type(value) is not str:
        return value
    return "\n".join(printable(line, LONGEST_TEXT) for line in value[:LONGEST_TEXT].split("\n"))
