"""How much a request may bring along."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fastapi import HTTPException

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

MOST_BODY_BYTES = 2**20
"""Of a request."""
MOST_MESSAGE_BYTES = 2**16
"""Of a message to a WebSocket."""


class BodyLimit:
    """ASGI application that refuses bodies larger than pages send, whatever a request says of its length."""

    def __init__(self, app: ASGIApp) -> None:
        """Stand in front of an application."""
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve a connection."""
        received = 0

        async def receiving() -> Message:
            nonlocal received
            message = await receive()
            received += len(message.get("body", b""))
            if received > MOST_BODY_BYTES:
                raise HTTPException(413, f"a request may bring along {MOST_BODY_BYTES:,} bytes at most")
            return message

        await self._app(scope, receiving if scope["type"] == "http" else receive, send)
