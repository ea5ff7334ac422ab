"""HTML of pages from templates; every foreign text in it is escaped and printable."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape
from starlette.requests import Request
from starlette.responses import HTMLResponse

from juicer.text import printable

TEMPLATES = Path(__file__).with_name("templates")
LONGEST_TEXT = 20_000
"""Letters of one value that a page shows."""

_COMMAND = re.compile("`([^`]+)`")

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
    environment.filters["sentence"] = _sentence
    return environment


def _sentence(clause: str) -> Markup:
    """A clause of an error as a sentence: commands in it stand out, and it begins with a capital letter or a name."""
    text = printable(clause, LONGEST_TEXT)
    if "/" not in text.partition(" ")[0]:
        text = text[:1].upper() + text[1:]
    return Markup(_COMMAND.sub(r"<code>\1</code>", str(escape(text)))) + "."


def _shown(value: Any) -> Any:
    """Texts with every character escaped that a page cannot show, or that turns the direction of what follows."""
    # Markup is a text as well, and made here.
    if type(value) is not str:
        return value
    return "\n".join(printable(line, LONGEST_TEXT) for line in value[:LONGEST_TEXT].split("\n"))
