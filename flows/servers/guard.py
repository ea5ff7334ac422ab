"""What stands in front of every server that juicer runs, and decides whom it answers.

Any web page that a browser has open can send requests to servers on the same machine. Neither Prefect nor MLflow
turns all of them away: Prefect allows every origin and host name, MLflow every page that is served from this machine.
"""

from __future__ import annotations

import base64
import hmac
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

OPEN_PATHS = frozenset({"/health", "/api/health", "/api/ready"})
"""Whether a server lives is no secret: health checks ask without a password."""

_SECURITY_HEADERS = {
    # Pages that are sent to nobody but this server do not report to their makers either.
    b"content-security-policy": b"frame-ancestors 'self'; connect-src 'self' data: blob:",
    b"x-frame-options": b"SAMEORIGIN",
    b"x-content-type-options": b"nosniff",
    b"cross-origin-resource-policy": b"same-origin",
    b"cross-origin-opener-policy": b"same-origin",
    b"referrer-policy": b"same-origin",
}
_ADDED = (b"content-security-policy",)
"""May stand beside the server's own of this name: a browser keeps to all of them."""

_OWN_SITE = ("same-origin", "none")


@dataclass(frozen=True)
class Credentials:
    """What a server asks for.

    Attributes:
        user: User name.
        password: Password; it travels as it is, therefore no further than this machine without TLS.
    """

    user: str
    password: str

    @property
    def header(self) -> bytes:
        """Value of the header ``Authorization``."""
        return b"Basic " + base64.b64encode(f"{self.user}:{self.password}".encode())


@dataclass(frozen=True)
class Refusal:
    """Why a request is not answered.

    Attributes:
        status: HTTP status.
        sentence: For whoever sent it.
    """

    status: int
    sentence: str


def loopback_names(port: int) -> frozenset[str]:
    """What a server on this machine is called by those who reach it on this machine."""
    return frozenset(_authority(f"{name}:{port}") for name in ("127.0.0.1", "localhost", "[::1]"))


def host_name(text: str) -> str:
    """Host and port, as a browser sends them, of a name or an address such as ``https://prefect.example.org``."""
    return _authority((text.partition("://")[2] or text).partition("/")[0])


def host_names(texts: Iterable[str]) -> frozenset[str]:
    """:func:`host_name` of each text that is not empty."""
    return frozenset(host_name(text.strip()) for text in texts if text.strip())


def _authority(text: str) -> str:
    # Browsers leave out the port that goes without saying.
    return text.lower().removesuffix(":80").removesuffix(":443")


class Guard:
    """ASGI application that passes on what a server may answer, and refuses the rest with a sentence."""

    def __init__(self, app: ASGIApp, hosts: Collection[str], credentials: Credentials | None = None) -> None:
        """Stand in front of a server.

        Args:
            app: The server.
            hosts: Host and port by which it may be reached, as in :func:`host_name`. Pages from there are its own.
            credentials: What every request must bring along; none if the server itself asks for a password.
        """
        self._app = app
        self._hosts = frozenset(hosts)
        self._credentials = credentials

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve a connection."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
        elif refusal := self.refusal(scope):
            await _refuse(refusal, scope, send)
        else:
            await self._app(scope, receive, _hardened(send))

    def refusal(self, scope: Scope) -> Refusal | None:
        """Why a request must not reach the server; none if it may."""
        method = scope.get("method", "GET")
        headers: dict[bytes, list[str]] = {}
        for name, value in scope["headers"]:
            headers.setdefault(name.lower(), []).append(value.decode("latin-1"))
        return (
            self._wrong_host(headers.get(b"host", []))
            or self._foreign_origin(headers.get(b"origin", []))
            or _foreign_site(scope["type"], method, headers)
            or self._wrong_password(scope["path"], method, headers.get(b"authorization", []))
        )

    def _wrong_host(self, hosts: list[str]) -> Refusal | None:
        if len(hosts) == 1 and _authority(hosts[0]) in self._hosts:
            return None
        return Refusal(403, "this server does not answer to that host name; JUICER_ALLOWED_HOSTS can add names")

    def _foreign_origin(self, origins: list[str]) -> Refusal | None:
        if not origins:
            return None
        # A sandboxed page sends `null`, which is nobody's name.
        scheme, _, authority = origins[0].partition("://")
        if len(origins) == 1 and scheme in ("http", "https") and _authority(authority) in self._hosts:
            return None
        return Refusal(403, "requests of other web pages are not answered")

    def _wrong_password(self, path: str, method: str, given: list[str]) -> Refusal | None:
        if self._credentials is None or (path in OPEN_PATHS and method in ("GET", "HEAD")):
            return None
        if len(given) == 1 and hmac.compare_digest(_normal(given[0]), self._credentials.header):
            return None
        return Refusal(401, "user name and password are missing or wrong")


def _normal(authorization: str) -> bytes:
    scheme, _, token = authorization.partition(" ")
    return f"{scheme.capitalize()} {token.strip()}".encode()


def _foreign_site(kind: str, method: str, headers: dict[bytes, list[str]]) -> Refusal | None:
    """Browsers tell where a request comes from even when they send no origin, as for pictures and links."""
    if all(site in _OWN_SITE for site in headers.get(b"sec-fetch-site", [])):
        return None
    # A link from elsewhere may open a page in the place of its own, of which it sees nothing.
    opens_page = headers.get(b"sec-fetch-mode") == ["navigate"] and headers.get(b"sec-fetch-dest") == ["document"]
    if kind == "http" and method in ("GET", "HEAD") and opens_page:
        return None
    return Refusal(403, "requests of other web pages are not answered")


def _hardened(send: Send) -> Send:
    """Let no permission for other pages out, and none to show this one within them."""

    async def sending(message: Message) -> None:
        if message["type"] in ("http.response.start", "websocket.http.response.start"):
            kept = [
                (name, value)
                for name, value in message.get("headers", [])
                if not name.lower().startswith(b"access-control-")
                and (name.lower() not in _SECURITY_HEADERS or name.lower() in _ADDED)
            ]
            message = {**message, "headers": [*kept, *_SECURITY_HEADERS.items()]}
        await send(message)

    return sending


async def _refuse(refusal: Refusal, scope: Scope, send: Send) -> None:
    prefix = ""
    if scope["type"] == "websocket":
        if "websocket.http.response" not in scope.get("extensions", {}):
            await send({"type": "websocket.close", "code": 1008, "reason": refusal.sentence})
            return
        prefix = "websocket."
    headers = [(b"content-type", b"text/plain; charset=utf-8"), *_SECURITY_HEADERS.items()]
    if refusal.status == 401:
        headers.append((b"www-authenticate", b'Basic realm="juicer", charset="UTF-8"'))
    await send({"type": f"{prefix}http.response.start", "status": refusal.status, "headers": headers})
    await send({"type": f"{prefix}http.response.body", "body": f"{refusal.sentence}\n".encode()})
