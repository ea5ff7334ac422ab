"""The one live session of a server, and the pages that watch it or have its controls."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from juicer.errors import ConfigError, RefusedMessage, UnusableDraft, did_you_mean
from juicer.pages.teleoperating.under_way import UnderWay
from juicer.pages.teleoperating.wire import Begin, Pace, Resume
from juicer.sim.env import STEP_S
from juicer.tasks.registry import TASK_NAMES
from juicer.tasks.specification import Randomness
from juicer.teleoperation.controls import ControllerState, Controls
from juicer.teleoperation.drafts import LeftDraft, left_in, read_draft
from juicer.teleoperation.key_maps import DEFAULT, DESCRIPTIONS, PRESETS, KeyMap, Motion, find_key_map
from juicer.teleoperation.logs import DRAFTS, Logs
from juicer.teleoperation.messages import MessageReader
from juicer.teleoperation.painter import PANES, Frame, Painter
from juicer.teleoperation.session import Session
from juicer.teleoperation.verification import Verifier
from juicer.teleoperation.work import Choice, Work
from juicer.text import printable

MOST_DRAFTS = 10
"""Interrupted episodes that are offered, the latest first."""


class Client:
    """A page that is connected.

    Attributes:
        news: Set when there may be something to be sent.
        under_way: Frames that it has not acknowledged yet.
        number: Number of the frame that it has; -1 before the first.
        sent: By name of the pane, the number of the image that it has.
        wants_numbers: Whether it asked for the observation as numbers, too.
        reader: Judges its messages.
        controls: Turns its keys into wishes.
        state: What it said last of its keys; None before it said anything.
    """

    def __init__(self) -> None:
        """Begin with the connection."""
        self.news = asyncio.Event()
        self._loop = asyncio.get_running_loop()
        self.under_way = UnderWay()
        self.number = -1
        self.sent: dict[str, int] = {}
        self.wants_numbers = False
        self.reader = MessageReader()
        self.controls = Controls()
        self.state: ControllerState | None = None

    def forget_presses(self) -> None:
        """What was pressed in vain, while somebody else had the controls, is not to be done now."""
        while self.state and self.controls.intent(self.state).presses:
            pass

    def wake(self) -> None:
        """Look for something to be sent; any thread may call it."""
        try:
            self._loop.call_soon_threadsafe(self.news.set)
        except RuntimeError:  # the server has ended
            return


class Hub:
    """Who is connected, who has the controls, and what goes on.

    Attributes:
        folder: Where recordings lie, a folder a task.
    """

    def __init__(self, folder: Path) -> None:
        """Begin with nothing going on."""
        self.folder = folder
        self._clients: set[Client] = set()
        self._driver: Client | None = None
        self._session: Session | None = None
        self._painter: Painter | None = None
        self._key_map: KeyMap = DEFAULT
        self._verifier = Verifier()
        self._number = 0

    @property
    def frame(self) -> Frame | None:
        """The newest frame."""
        return self._painter.frame if self._painter else None

    def enter(self) -> Client:
        """A page connects; it gets the controls if nobody has them."""
        client = Client()
        self._clients.add(client)
        if self._painter:
            self._painter.watch(client.wake)
        if self._driver is None:
            self.give_controls(client)
        return client

    def leave(self, client: Client) -> None:
        """A page is gone."""
        self._clients.discard(client)
        if self._painter:
            self._painter.leave(client.wake)
        if self.drives(client):
            self._driver = None
            self.release()
            self._wake_all()

    def drives(self, client: Client) -> bool:
        """Whether a page has the controls."""
        return self._driver is client

    def give_controls(self, client: Client) -> None:
        """A page takes the controls from whoever has them."""
        self._driver = client
        client.controls.key_map = self._key_map
        client.forget_presses()
        if self._session:
            self._session.take_over(client.controls)
        self._wake_all()

    def hear(self, client: Client, state: ControllerState) -> None:
        """Take what a page's operator does; it counts if the page has the controls."""
        client.state = state
        if self._session and self.drives(client):
            self._session.hear(state)

    def pace(self, client: Client, order: Pace) -> None:
        """Change the pace, if the page has the controls."""
        if self._session and self.drives(client):
            self._session.pace(order.time_scale, order.undo_s)

    def release(self) -> None:
        """Nobody holds the controls until the next message."""
        if self._session:
            self._session.release()

    async def begin(self, client: Client, order: Begin) -> None:
        """End what goes on and record something else.

        Raises:
            RefusedMessage: If another page has the controls.
            ConfigError: If there is no such task, randomness or key map; what went on goes on.
            LogNotWritten: If the folder of the logs cannot be written.
        """
        self._check_drives(client)
        choice = Choice(
            task=order.task,
            randomness=order.randomness,
            operator=printable(order.operator.strip()),
            target=order.target,
            keys=order.keys,
        )
        await self._start(client, lambda: self._work(choice))

    async def resume(self, client: Client, order: Resume) -> None:
        """End what goes on, and go on with an episode that was interrupted, or remove what was recorded of it.

        Raises:
            RefusedMessage: If another page has the controls, or there is no such episode.
            UnusableDraft: If it cannot be gone on with.
        """
        self._check_drives(client)
        found = [path for path in self._left() if (path.parents[1].name, path.name) == (order.task, order.draft)]
        if not found:
            raise RefusedMessage("that episode is no longer there: somebody has gone on with it, or removed it")
        if order.kind == "forget":
            read_draft(found[0]).remove()
            self._wake_all()
        else:
            await self._start(client, lambda: self._resumed(read_draft(found[0]), order.target))

    def _check_drives(self, client: Client) -> None:
        if self._session and not self.drives(client):
            raise RefusedMessage("another page has the controls; take them over before you begin something else")

    def _resumed(self, left: LeftDraft, target: int) -> Work:
        beginning = left.beginning
        choice = Choice(
            task=beginning.task,
            randomness=beginning.randomness,
            operator=beginning.operator,
            target=target,
            keys=beginning.keys,
        )
        work = self._work(choice)
        work.resume(left)
        return work

    def _work(self, choice: Choice) -> Work:
        if choice.task not in TASK_NAMES:
            raise ConfigError(f"there is no task '{printable(choice.task)}'; there are {', '.join(TASK_NAMES)}")
        self._find_key_map(choice.keys)
        return Work(choice, Logs(self.folder / choice.task, choice.task, self._verifier))

    async def _start(self, client: Client, make: Callable[[], Work]) -> None:
        # Building a scene takes a second, in which others are to be served.
        work = await asyncio.to_thread(make)
        self.end()
        self._key_map = self._find_key_map(work.choice.keys)
        self._session = Session(work, self._number)
        self._painter = Painter(self._session)
        self._session.start()
        self._painter.start()
        for each in self._clients:
            each.number, each.sent = -1, {}
            self._painter.watch(each.wake)
        self.give_controls(client)

    def end(self) -> None:
        """End what goes on; what was recorded of the episode in hand stays on the disk."""
        if self._painter:
            self._painter.close()
        if self._session:
            self._session.close()
            # Pages tell an older frame from a newer one by its number.
            self._number = self._session.latest.number + 1
        self._session = self._painter = None
        self._wake_all()

    def greeting(self) -> dict[str, Any]:
        """What a page must know before anything goes on."""
        return {
            "kind": "greeting",
            "tasks": list(TASK_NAMES),
            "randomness": [level.value for level in Randomness],
            "key_maps": [*PRESETS, *self._own_key_maps()],
            "panes": [
                {name: getattr(each, name) for name in ("name", "title", "width", "height", "of_policy")}
                for each in PANES
            ],
            "folder": str(self.folder),
        }  # fmt: skip

    def status(self, client: Client) -> dict[str, Any]:
        """What a page is to say now."""
        told: dict[str, Any] = {
            "drives": self.drives(client),
            "is_driven": self._driver is not None,
            "going_on": self._session is not None,
            "drafts": [] if self._session else self._drafts(),
            "key_list": _shown_keys(self._key_map),
        }
        if frame := self.frame:
            told |= {**asdict(frame.snapshot.status), "problem": frame.problem}
            if client.wants_numbers:
                told["numbers"] = frame.snapshot.numbers()
        return told

    def close(self) -> None:
        """End everything."""
        self.end()
        self._verifier.close()

    def _left(self) -> list[Path]:
        """Files of interrupted episodes, the latest first."""
        return [path for folder in sorted(self.folder.glob(f"*/{DRAFTS}")) for path in left_in(folder)][:MOST_DRAFTS]

    def _drafts(self) -> list[dict[str, Any]]:
        """What is told of interrupted episodes."""
        told = []
        for path in self._left():
            with suppress(UnusableDraft):
                left = read_draft(path)
                about = {name: printable(getattr(left.beginning, name)) for name in ("task", "operator", "began")}
                told.append({"draft": path.name, "seconds": len(left.steps) * STEP_S, **about})
        return told

    def _find_key_map(self, name: str) -> KeyMap:
        own = self._own_key_maps()
        if name not in own and name not in PRESETS:
            # A page may not name any file of this machine.
            raise ConfigError(
                f"there is no key map '{printable(name)}'{did_you_mean(name, [*PRESETS, *own])}; "
                f"your own are files in '{printable(self.folder)}' that end in .toml"
            )
        return find_key_map(str(own.get(name, name)))

    def _own_key_maps(self) -> Mapping[str, Path]:
        """Key maps that lie beside the recordings, by their names."""
        return {printable(path.name, 60): path for path in sorted(self.folder.glob("*.toml"))[:20]}

    def _wake_all(self) -> None:
        for client in self._clients:
            client.wake()


def _shown_keys(key_map: KeyMap) -> list[dict[str, Any]]:
    """What keys mean, in the order of the meanings."""
    keys: dict[str, list[str]] = {}
    for key, meaning in key_map.keys.items():
        keys.setdefault(meaning, []).append(key)
    return [
        {"meaning": meaning, "text": text, "keys": keys[meaning], "is_motion": isinstance(meaning, Motion)}
        for meaning, text in DESCRIPTIONS.items()
        if meaning in keys
    ]
