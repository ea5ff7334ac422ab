"""The web application: every page, what a browser may do with it, and what is said when something is wrong."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from http import HTTPStatus
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fastapi import FastAPI
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.staticfiles import StaticFiles

from juicer.errors import (
    AnnotationsNotSaved,
    ArtifactNotFound,
    ConfigError,
    InvalidLabels,
    JuicerError,
    StoreNotWritable,
    WrongArtifactKind,
)
from juicer.pages.annotating.routes import router as annotating
from juicer.pages.browsing.routes import router as browsing
from juicer.pages.limits import BodyLimit
from juicer.pages.rendering import page
from juicer.pages.teleoperating.routes import router as teleoperating
from juicer.pages.workplace import Workplace
from juicer.text import printable

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

AREAS = (
    browsing,
    teleoperating,
    annotating,
)  # fmt: skip

STATIC = Path(__file__).with_name("static")

CONTENT_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self'; "
    "form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
)
"""What a browser lets a page do: nothing that this server does not send as a file of its own."""

_STATUS = {
    ArtifactNotFound: HTTPStatus.NOT_FOUND,
    WrongArtifactKind: HTTPStatus.NOT_FOUND,
    ConfigError: HTTPStatus.BAD_REQUEST,
    InvalidLabels: HTTPStatus.BAD_REQUEST,
    StoreNotWritable: HTTPStatus.INSUFFICIENT_STORAGE,
    AnnotationsNotSaved: HTTPStatus.INSUFFICIENT_STORAGE,
    # With every other one, nothing is wrong with the request: what it is about must be mended, or be waited for.
    JuicerError: HTTPStatus.CONFLICT,
}
"""Status of a mistake: that of the nearest of its classes which is named here."""

logger = logging.getLogger(__name__)


def create_application(workplace: Workplace) -> FastAPI:
    """Every page; whoever serves it puts :class:`~juicer.pages.access.Access` and a check of host names in front."""
    application = FastAPI(title="juicer", docs_url=None, redoc_url=None, openapi_url=None)
    application.state.workplace = workplace
    for area in AREAS:
        application.include_router(area)
    application.mount("/static", StaticFiles(directory=STATIC))
    application.add_exception_handler(JuicerError, _mistake)
    application.add_exception_handler(HTTPException, _refusal)
    application.add_exception_handler(RequestValidationError, _invalid)
    application.add_exception_handler(Exception, _defect)
    application.add_middleware(BodyLimit)
    application.add_middleware(_Policy)
    application.add_middleware(_Head)
    return application


class _Policy:
    """ASGI application that adds the content policy to every answer but those to a defect, which bring it along."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def sending(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = [*message.get("headers", ()), (b"content-security-policy", CONTENT_POLICY.encode())]
                message = {**message, "headers": headers}
            await send(message)

        await self._app(scope, receive, sending)


class _Head:
    """ASGI application that answers HEAD as it does GET, without a body."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or scope["method"] != "HEAD":
            await self._app(scope, receive, send)
            return

        async def sending(message: Message) -> None:
            await send({**message, "body": b""} if message["type"] == "http.response.body" else message)

        await self._app({**scope, "method": "GET"}, receive, sending)


def _mistake(request: Request, error: Exception) -> Response:
    status = next(_STATUS[kind] for kind in type(error).__mro__ if kind in _STATUS)
    return _answer(request, str(error), status)


def _refusal(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    if error.status_code == 404 and error.detail == "Not Found":
        return _answer(request, f"there is no page '{printable(request.url.path)}'", 404)
    if error.status_code == 405:
        sentence = f"'{printable(request.url.path)}' does not answer to {printable(request.method)}"
        return _answer(request, sentence, 405, {"Allow": _allowed(error)})
    return _answer(request, str(error.detail), error.status_code, error.headers)


def _allowed(error: HTTPException) -> str:
    """What an address answers to instead; static files do not say it."""
    methods = set((error.headers or {}).get("Allow", "GET").split(", "))
    return ", ".join(sorted(methods | {"HEAD"} if "GET" in methods else methods))


def _invalid(request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    first = error.errors()[0]
    return _answer(request, _complaint(first), 400)


def _complaint(error: Mapping[str, Any]) -> str:
    if error["type"] == "json_invalid":
        why, place = str(error["ctx"]["error"]), error["loc"][-1]
        return f"the body is not JSON: {printable(why[:1].lower() + why[1:])}, at letter {place + 1}"
    name = ".".join(map(str, error["loc"][1:]))
    subject = f"'{printable(name)}'" if name else "the request"
    return f"{subject} is not valid: {printable(error['msg'].removeprefix('Value error, '))}"


def _defect(request: Request, error: Exception) -> Response:
    sentence = "this page failed, which is a defect of juicer; the terminal that serves it says more"
    answer = _answer(request, sentence, 500)
    answer.headers["content-security-policy"] = CONTENT_POLICY
    return answer


def _answer(request: Request, sentence: str, status: int, headers: Mapping[str, str] | None = None) -> Response:
    """The sentence as a page for people, and as JSON for scripts."""
    answer: Response
    if "text/html" in request.headers.get("accept", ""):
        answer = page(request, "sentence.html", status, sentence=sentence)
    else:
        answer = JSONResponse({"error": printable(sentence, 10_000)}, status)
    answer.headers.update(headers or {})
    return answer
