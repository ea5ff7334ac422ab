"""Who may see the pages: whoever once opened an address that holds the token, and their browser from then on.

Other users of this machine reach its loopback too, and so may programs that are not trusted.
"""

from __future__ import annotations

import hashlib
import hmac
from typing import TYPE_CHECKING
from urllib.parse import parse_qsl, urlencode

from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse, RedirectResponse, Response

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Receive, Scope, Send

PARAMETER = "token"
UNAUTHORIZED = 401
MAX_AGE_SECONDS = 365 * 24 * 3600
_POLICY_VIOLATION = 1008
_SENTENCE = (
    "This page is not shown to everybody: open it once by the address, with its token, that `juicer pages` printed."
)


class Access:
    """ASGI application that passes on the requests of those who know the token."""

    def __init__(self, app: ASGIApp, token: str) -> None:
        """Stand in front of an application."""
        self._app = app
        self._token = token.encode()
        # Cookies are shared by all ports of a host name: each server has a name of its own.
        self._cookie = f"juicer-{hashlib.sha256(self._token).hexdigest()[:12]}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve a connection."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        connection = HTTPConnection(scope)
        given = [value for name, value in _parameters(scope) if name == PARAMETER]
        if scope["type"] == "http" and scope["method"] in ("GET", "HEAD") and any(map(self._is_token, given)):
            await self._welcome(scope)(scope, receive, send)
        elif self._is_token(connection.cookies.get(self._cookie, "")):
            await self._app(scope, receive, send)
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": _POLICY_VIOLATION, "reason": "the token is missing"})
        else:
            await PlainTextResponse(f"{_SENTENCE}\n", UNAUTHORIZED)(scope, receive, send)

    def _is_token(self, text: str) -> bool:
        return hmac.compare_digest(text.encode("utf-8", "replace"), self._token)

    def _welcome(self, scope: Scope) -> Response:
        """Remember the browser, and take the token out of its address, which people copy and screens show."""
        rest = urlencode([(name, value) for name, value in _parameters(scope) if name != PARAMETER])
        # A path with two slashes in front would be read as the name of another server.
        path = "/" + scope["path"].lstrip("/\\")
        answer = RedirectResponse(f"{path}?{rest}" if rest else path, 303)
        # Lax: a link in a message opens its page. What a foreign page loads or posts is refused whatever cookie it has.
        answer.set_cookie(self._cookie, self._token.decode(), max_age=MAX_AGE_SECONDS, httponly=True, samesite="lax")
        return answer


def _parameters(scope: Scope) -> list[tuple[str, str]]:
    return parse_qsl(scope["query_string"].decode("latin-1"), keep_blank_values=True)
