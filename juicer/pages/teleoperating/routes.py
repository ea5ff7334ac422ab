"""Addresses of teleoperation: its page, and the socket behind it."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from typing import Any

from fastapi import APIRouter, FastAPI, WebSocket
from starlette.requests import Request
from starlette.responses import Response
from starlette.websockets import WebSocketDisconnect

from juicer.artifacts.ref import ArtifactRef
from juicer.errors import JuicerError, RefusedMessage
from juicer.pages.browsing.episodes import recorded_episode
from juicer.pages.paging import Number, Word
from juicer.pages.rendering import page
from juicer.pages.teleoperating.hub import Client, Hub
from juicer.pages.teleoperating.wire import (
    Acknowledge,
    Begin,
    Correct,
    Pace,
    Resume,
    Simple,
    TakeOver,
    packed,
    parse_command,
)
from juicer.pages.workplace import TheWorkplace, Workplace
from juicer.teleoperation.messages import MOST_BYTES
from juicer.teleoperation.origin import Origin, origin_of
from juicer.text import printable

FOLDER = "teleoperation"
"""Name, in the data folder, of where recordings lie."""
MOST_REFUSALS = 50
"""Messages that cannot be understood after which a connection is closed."""
_FOREIGN, _TOO_LARGE, _REFUSED = 1003, 1009, 1008


@asynccontextmanager
async def _hub_of_application(application: FastAPI) -> AsyncIterator[None]:
    workplace: Workplace = application.state.workplace
    hub = Hub(workplace.folder / FOLDER, workplace.store)
    application.state.teleoperation = hub
    try:
        yield
    finally:
        hub.close()


router = APIRouter(lifespan=_hub_of_application)


@dataclass(frozen=True)
class _Rollout:
    """What the page says of a rollout that is to be finished by hand."""

    ref: ArtifactRef
    episode: int
    origin: Origin
    task: str


@router.get("/teleop")
def teleop(
    request: Request,
    workplace: TheWorkplace,
    artifact: Word = "",
    episode: Number = 0,
    frame: Number = 0,
) -> Response:
    """The page; on a step of a rollout, to finish that by hand."""
    return page(request, "teleop.html", rollout=_rollout(workplace, artifact, episode, frame) if artifact else None)


def _rollout(workplace: Workplace, artifact: str, number: int, step: int) -> _Rollout:
    ref = workplace.store.resolve(artifact)
    episode = recorded_episode(workplace.store, ref, number)
    return _Rollout(ref, number, origin_of(episode, step), episode.record.task)


@router.websocket("/teleop/live")
async def live(socket: WebSocket) -> None:
    """One page's connection, from its opening to its end."""
    hub: Hub = socket.app.state.teleoperation
    await socket.accept()
    await socket.send_text(json.dumps(hub.greeting()))
    client = hub.enter()
    sender = asyncio.create_task(_send(socket, hub, client))
    try:
        await _receive(socket, hub, client)
    except WebSocketDisconnect:
        pass
    finally:
        hub.leave(client)
        sender.cancel()
        with suppress(asyncio.CancelledError, WebSocketDisconnect, RuntimeError):
            await sender


async def _send(socket: WebSocket, hub: Hub, client: Client) -> None:
    """Tell a page what is new: its status whenever that changes, and the newest frame as often as it can take one."""
    told: dict[str, Any] = {}
    while True:
        status = hub.status(client)
        if status != told:
            news = {name: value for name, value in status.items() if told.get(name) != value}
            await socket.send_text(json.dumps({"kind": "status", **news}))
            told = status
        frame = hub.frame
        if frame and frame.pictures and not client.under_way.is_full and frame.snapshot.number != client.number:
            data = packed(frame, client.sent)
            client.number = frame.snapshot.number
            client.under_way.send(client.number, time.monotonic())
            client.sent = {name: picture.number for name, picture in frame.pictures.items()}
            await socket.send_bytes(data)
        await client.news.wait()
        client.news.clear()


async def _receive(socket: WebSocket, hub: Hub, client: Client) -> None:
    """Do what a page says, until it is gone or says what no page does."""
    refusals = 0
    while True:
        message = await socket.receive()
        if message["type"] == "websocket.disconnect":
            return
        text = message.get("text")
        if text is None:
            await socket.close(_FOREIGN, "messages are JSON texts")
            return
        if len(text) > MOST_BYTES:
            await socket.close(_TOO_LARGE, f"a message has at most {MOST_BYTES:,} letters")
            return
        try:
            await _obey(hub, client, text)
        except JuicerError as error:
            refusals += isinstance(error, RefusedMessage)
            await socket.send_text(json.dumps({"kind": "refused", "sentence": str(error)}))
            if refusals == MOST_REFUSALS:
                await socket.close(_REFUSED, "too many messages could not be understood")
                return


_SIMPLE: Mapping[str, Callable[[Hub, Client], None]] = {
    "end": Hub.finish,
    "numbers": Hub.show_numbers,
    "release": Hub.let_go,
}
"""What is done for an order that says nothing but its kind."""


async def _obey(hub: Hub, client: Client, text: str) -> None:
    command = parse_command(text)
    match command:
        case None:
            hub.hear(client, client.reader.read(text))
        case Acknowledge():
            client.under_way.painted(command.number, time.monotonic())
            client.news.set()
        case Begin():
            await hub.begin(client, command)
        case Correct():
            await hub.correct(client, command)
        case Resume():
            await hub.resume(client, command)
        case Pace():
            hub.pace(client, command)
        case TakeOver():
            hub.give_controls(client, printable(command.operator.strip()))
        case Simple():
            _SIMPLE[command.kind](hub, client)
