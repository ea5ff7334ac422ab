"""What a page says and hears, without a browser."""

from __future__ import annotations

import json
import struct
import time
from collections.abc import Callable
from typing import Any

from starlette.testclient import WebSocketTestSession
from starlette.websockets import WebSocketDisconnect

HEADER = struct.Struct("<BBHiiiid")


class Page:
    """What a page does, without a browser."""

    def __init__(self, socket: WebSocketTestSession) -> None:
        self._socket = socket
        self.status: dict[str, Any] = {}
        self.refusals: list[str] = []
        self.frames: list[bytes] = []
        self.sequence = 0
        self.edges: dict[str, int] = {}
        self.greeting = json.loads(socket.receive_text())

    def say(self, message: object) -> None:
        self._socket.send_text(message if isinstance(message, str) else json.dumps(message))

    def hold(self, *keys: str) -> None:
        self.sequence += 1
        self.say({"source": "keyboard", "sequence": self.sequence, "held": keys, "edges": self.edges})

    def press(self, key: str) -> None:
        self.edges[key] = self.edges.get(key, 0) + 1
        self.hold()

    def hear(self, paints: bool = True) -> None:
        """Take one message, and acknowledge it if it is a frame."""
        message = self._socket.receive()
        if message["type"] == "websocket.close":
            raise WebSocketDisconnect(message["code"], message.get("reason"))
        if data := message.get("bytes"):
            self.frames.append(data)
            if paints:
                self.say({"kind": "painted", "number": HEADER.unpack_from(data)[3]})
            return
        content = json.loads(message["text"])
        if content.pop("kind") == "refused":
            self.refusals.append(content["sentence"])
        else:
            self.status |= content

    def until(self, test: Callable[[], bool], *keys: str, silent: bool = False) -> None:
        end = time.monotonic() + 60
        while not test():
            assert time.monotonic() < end, "it never came"
            if not silent:
                self.hold(*keys)
            self.hear()

    def begin(self, **order: object) -> None:
        self.say({"kind": "begin", "task": "one_leg", "operator": "Anna", "target": 3, **order})
        self.until(lambda: self.status.get("going_on", False) and len(self.frames) > 0, silent=True)

    def steps(self) -> int:
        return self.status["step"]
