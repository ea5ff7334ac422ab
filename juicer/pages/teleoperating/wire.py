"""What goes over the socket: binary frames to the page, JSON from it and, as status, to it.

A frame begins with a header of little-endian numbers: kind (1), number of images, two bytes of zero; number of the
frame, sequence number of the last message that had arrived when it was made, that of the message that the last step of
the simulator obeyed, and the simulator's step, each 32 bits, -1 where there is none; the server's monotonic clock
[ms, 64-bit float]; and the length of each image, 32 bits, 0 for one that has not changed since the last frame that was
sent. The JPEG images follow, in the order in which the greeting names them.
"""

from __future__ import annotations

import json
import struct
import time
from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Field, TypeAdapter, ValidationError

from juicer.config import StrictConfig
from juicer.errors import RefusedMessage
from juicer.problems import show
from juicer.teleoperation.painter import PANES, Frame

FRAME = 1
_HEADER = struct.Struct("<BBHiiiid")


def packed(frame: Frame, sent: Mapping[str, int]) -> bytes:
    """A frame as bytes.

    Args:
        frame: What is shown.
        sent: By name of the pane, the number of the image that the page has already.
    """
    snapshot = frame.snapshot
    header = _HEADER.pack(
        FRAME, len(PANES), 0, snapshot.number, snapshot.heard, snapshot.moved_by, snapshot.status.step,
        time.monotonic() * 1000,
    )  # fmt: skip
    images = [
        picture.jpeg if (picture := frame.pictures.get(pane.name)) and sent.get(pane.name) != picture.number else b""
        for pane in PANES
    ]
    return b"".join([header, struct.pack(f"<{len(images)}I", *map(len, images)), *images])


Name = Annotated[str, Field(max_length=60)]


class Order(StrictConfig):
    """What an operator says of every sitting: how many demonstrations are wanted, and whether a SpaceMouse is used."""

    target: int = Field(default=50, ge=1, le=100_000)
    spacemouse: bool = False


class Begin(Order):
    """Record demonstrations: of what, and by whom."""

    kind: Literal["begin"]
    task: Name
    randomness: Name = "low"
    operator: Name = ""
    keys: Name = "original"


class Correct(Order):
    """Finish a rollout by hand, from one of its steps on: which, and who does it."""

    kind: Literal["correct"]
    artifact: Name
    episode: int = Field(ge=0, le=10**9)
    step: int = Field(ge=0, le=10**9)
    operator: Name = ""
    keys: Name = "original"


class Resume(Order):
    """Go on with an episode that was interrupted, or remove what was recorded of it.

    Keys and operator are those that it was begun with, unless others are named.
    """

    kind: Literal["resume", "forget"]
    task: Name
    draft: Name
    operator: Name = ""
    keys: Name = ""


class Pace(StrictConfig):
    """How fast time passes, and what the longer undo takes back."""

    kind: Literal["pace"]
    time_scale: float = Field(ge=0.25, le=1)
    undo_s: float = Field(ge=0.1, le=60)


class TakeOver(StrictConfig):
    """Take the controls from whoever has them: who drives from then on."""

    kind: Literal["take over"]
    operator: Name = ""


class Acknowledge(StrictConfig):
    """A frame was painted: another may be sent."""

    kind: Literal["painted"]
    number: int = Field(ge=-1, lt=2**31)


class Simple(StrictConfig):
    """What needs no more words."""

    kind: Literal["release", "end", "numbers"]


Command = Begin | Correct | Resume | Pace | TakeOver | Acknowledge | Simple
_COMMAND: TypeAdapter[Command] = TypeAdapter(Annotated[Command, Field(discriminator="kind")])


def parse_command(text: str) -> Command | None:
    """A command of a page; None if the text says nothing of a kind, as the state of a controller does.

    Raises:
        RefusedMessage: If it is of a kind and yet no command.
    """
    try:
        content = json.loads(text)
    except (ValueError, RecursionError):
        return None
    if not isinstance(content, dict) or "kind" not in content:
        return None
    try:
        return _COMMAND.validate_python(content)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(each) for each in first["loc"][1:]) or "kind"
        wrong = f"'{where}' of a command is not valid: {first['msg']}, got {show(first['input'])}"
        raise RefusedMessage(wrong) from None
