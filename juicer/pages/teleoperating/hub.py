"""The one live session of a server, and the pages that watch it or have its controls."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from juicer.artifacts.store import ArtifactStore
from juicer.errors import ConfigError, DeviceUnavailable, RefusedMessage, did_you_mean
from juicer.pages.browsing.episodes import recorded_episode
from juicer.pages.teleoperating.interrupted import interrupted, shown
from juicer.pages.teleoperating.under_way import UnderWay
from juicer.pages.teleoperating.wire import Begin, Correct, Order, Pace, Resume
from juicer.tasks.registry import TASK_NAMES
from juicer.tasks.specification import Randomness
from juicer.teleoperation.choice import Choice
from juicer.teleoperation.controls import ControllerState, Controls
from juicer.teleoperation.drafts import LeftDraft, read_draft, remove_draft
from juicer.teleoperation.key_maps import DEFAULT, DESCRIPTIONS, PRESETS, KeyMap, Motion, find_key_map, read_key_map
from juicer.teleoperation.logs import Logs
from juicer.teleoperation.messages import MessageReader
from juicer.teleoperation.origin import Origin, origin_of
from juicer.teleoperation.painter import PANES, Frame, Painter
from juicer.teleoperation.session import Session
from juicer.teleoperation.spacemouse import SpaceMouse, open_spacemouse
from juicer.teleoperation.verification import Verifier
from juicer.teleoperation.work import Work
from juicer.text import printable


class Client:
    """A page that is connected.

    Attributes:
        news: Set when there may be something to be sent.
        under_way: Frames that it has not acknowledged yet.
        number: Number of the frame that it has; -1 before the first.
        sent: By name of the pane, the number of the image that it has.
        wants_numbers: Whether it asked for the observation as numbers, too.
        reader: Judges its messages.
        state: What it said last of its keys; None before it said anything.
        was_told: Whether it was told that what it says of its keys does not count.
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
        self.state: ControllerState | None = None
        self.was_told = False

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

    def __init__(self, folder: Path, store: ArtifactStore) -> None:
        """Begin with nothing going on.

        Args:
            folder: Where recordings lie, a folder a task.
            store: Where the rollouts are that can be finished by hand.
        """
        self.folder = folder
        self._store = store
        self._clients: set[Client] = set()
        self._driver: Client | None = None
        self._session: Session | None = None
        self._painter: Painter | None = None
        self._mouse: SpaceMouse | None = None
        self._mouse_problem = ""
        self._starting = asyncio.Lock()
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

    def give_controls(self, client: Client, operator: str | None = None) -> None:
        """A page takes the controls from whoever has them; the operator is the same as before if None."""
        self._driver = client
        if self._session:
            # What was pressed in vain, while somebody else had the controls, is not to be done now.
            pressed = dict(client.state.edges) if client.state else {}
            with suppress(DeviceUnavailable):
                pressed |= self._mouse.read().edges if self._mouse else {}
            self._session.take_over(Controls(self._key_map, pressed), operator)
        self._wake_all()

    def hear(self, client: Client, state: ControllerState) -> None:
        """Take what a page's operator does; it counts if the page has the controls.

        Raises:
            RefusedMessage: Once a connection, if another page has them.
        """
        client.state = state
        if not self._session:
            return
        if not self.drives(client):
            if client.was_told:
                return
            client.was_told = True
            who = "another page has" if self._driver else "nobody has"
            raise RefusedMessage(f"{who} the controls, so that what you send does not count; take them over")
        try:
            self._session.hear(state.with_spacemouse(self._mouse.read()) if self._mouse else state)
        except DeviceUnavailable as error:
            # The page lets go of everything, too, as soon as it knows.
            self._mouse_problem = str(error)
            self._close_mouse()
            self.release()
            self._wake_all()

    def pace(self, client: Client, order: Pace) -> None:
        """Change the pace.

        Raises:
            RefusedMessage: If another page has the controls.
        """
        self._check_drives(client, "change the pace")
        if self._session:
            self._session.pace(order.time_scale, order.undo_s)

    def show_numbers(self, client: Client) -> None:
        """A page wants the observation as numbers as well."""
        client.wants_numbers = True
        client.wake()

    def let_go(self, client: Client) -> None:
        """A page's operator holds nothing; that counts if the page has the controls."""
        if self.drives(client):
            self.release()

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
            DeviceUnavailable: If a SpaceMouse is asked for and cannot be read.
        """
        self._check_drives(client)
        choice = _choice(order, order.task, order.randomness)
        await self._start(client, order, lambda: self._work(choice))

    async def correct(self, client: Client, order: Correct) -> None:
        """End what goes on and let a rollout be finished by hand.

        Raises:
            RefusedMessage: If another page has the controls.
            ArtifactError: If the episode does not exist or was removed; what went on goes on.
            JuicerError: If it cannot be gone on from, see :func:`~juicer.teleoperation.origin.origin_of`, or as for
                :meth:`begin`.
        """
        self._check_drives(client)

        def work() -> tuple[Work, KeyMap]:
            episode = recorded_episode(self._store, self._store.resolve(order.artifact), order.episode)
            choice = _choice(order, episode.record.task, episode.record.randomness)
            return self._work(choice, origin_of(episode, order.step))

        await self._start(client, order, work)

    async def resume(self, client: Client, order: Resume) -> None:
        """End what goes on, and go on with an episode that was interrupted, or remove what was recorded of it.

        Raises:
            RefusedMessage: If another page has the controls, or there is no such episode.
            UnusableDraft: If it cannot be gone on with, or not be removed.
            ConfigError: If there is no such key map.
            DeviceUnavailable: As for :meth:`begin`.
        """
        self._check_drives(client)
        left = interrupted(self.folder)
        found = [path for path in left if (path.parents[1].name, path.name) == (order.task, order.draft)]
        if not found:
            raise RefusedMessage("that episode is no longer there: somebody has gone on with it, or removed it")
        if order.kind == "forget":
            remove_draft(found[0])
            self._wake_all()
        else:
            await self._start(client, order, lambda: self._resumed(read_draft(found[0]), order))

    def _check_drives(self, client: Client, what: str = "begin something else") -> None:
        if self._session and self._driver not in (None, client):
            raise RefusedMessage(f"another page has the controls; take them over before you {what}")

    def _resumed(self, left: LeftDraft, order: Resume) -> tuple[Work, KeyMap]:
        beginning = left.beginning
        choice = Choice(
            task=beginning.task,
            randomness=beginning.randomness,
            operator=printable(order.operator.strip()) or beginning.operator,
            target=order.target,
            keys=order.keys or beginning.keys,
        )
        work, key_map = self._work(choice, left.origin)
        work.resume(left)
        return work, key_map

    def _work(self, choice: Choice, origin: Origin | None = None) -> tuple[Work, KeyMap]:
        if choice.task not in TASK_NAMES:
            raise ConfigError(f"there is no task '{printable(choice.task)}'; there are {', '.join(TASK_NAMES)}")
        key_map = self._find_key_map(choice.keys)
        return Work(choice, Logs(self.folder / choice.task, choice.task, self._verifier), origin), key_map

    async def _start(self, client: Client, order: Order, make: Callable[[], tuple[Work, KeyMap]]) -> None:
        # Building a scene takes a second, in which others are to be served, but not to begin something else.
        async with self._starting:
            self._check_drives(client)
            mouse = await asyncio.to_thread(open_spacemouse) if order.spacemouse else None
            try:
                work, key_map = await asyncio.to_thread(make)
            except BaseException:
                if mouse:
                    mouse.close()
                raise
            self.end()
            self._mouse = mouse
            self._key_map = key_map
            self._session = Session(work, self._number)
            self._painter = Painter(self._session)
            self._session.start()
            self._painter.start()
            for each in self._clients:
                each.number, each.sent = -1, {}
                self._painter.watch(each.wake)
            self.give_controls(client)

    def finish(self, client: Client) -> None:
        """End what goes on, as a page wants it.

        Raises:
            RefusedMessage: If another page has the controls.
        """
        self._check_drives(client, "end the episode")
        self.end()

    def end(self) -> None:
        """End what goes on; what was recorded of the episode in hand stays on the disk."""
        if self._painter:
            self._painter.close()
        if self._session:
            self._session.close()
            # Pages tell an older frame from a newer one by its number.
            self._number = self._session.latest.number + 1
        self._session = self._painter = None
        self._close_mouse()
        self._mouse_problem = ""
        self._wake_all()

    def _close_mouse(self) -> None:
        if self._mouse:
            self._mouse.close()
        self._mouse = None

    def greeting(self) -> dict[str, Any]:
        """What a page must know before anything goes on."""
        own, problems = self._read_own_key_maps()
        return {
            "kind": "greeting",
            "tasks": list(TASK_NAMES),
            "randomness": [level.value for level in Randomness],
            "key_maps": [*PRESETS, *own],
            "problems": problems,
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
            "drafts": [] if self._session else [shown(path) for path in interrupted(self.folder)],
            "key_list": _shown_keys(self._key_map),
            "spacemouse": self._mouse is not None,
        }
        if frame := self.frame:
            told |= {
                **asdict(frame.snapshot.status),
                # Who has just taken over is not in a frame yet.
                "operator": self._session.operator if self._session else "",
                "problem": " ".join(filter(None, (self._mouse_problem, frame.problem))),
            }
            if client.wants_numbers:
                told["numbers"] = frame.snapshot.numbers()
        return told

    def close(self) -> None:
        """End everything."""
        self.end()
        self._verifier.close()

    def _find_key_map(self, name: str) -> KeyMap:
        own = self._own_key_maps()
        if name not in own and name not in PRESETS:
            # A page may not name any file of this machine.
            raise ConfigError(
                f"there is no key map '{printable(name)}'{did_you_mean(name, [*PRESETS, *own])}; "
                f"your own are files in '{printable(self.folder)}' that end in .toml"
            )
        return find_key_map(str(own.get(name, name)))

    def _read_own_key_maps(self) -> tuple[list[str], list[str]]:
        """Names of those that can be used, and what is wrong with the others."""
        names, problems = [], []
        for name, path in self._own_key_maps().items():
            try:
                read_key_map(path)
            except ConfigError as error:
                problems.append(str(error))
            else:
                names.append(name)
        return names, problems

    def _own_key_maps(self) -> Mapping[str, Path]:
        """Key maps that lie beside the recordings, by their names."""
        return {printable(path.name, 60): path for path in sorted(self.folder.glob("*.toml"))[:20]}

    def _wake_all(self) -> None:
        for client in self._clients:
            client.wake()


def _choice(order: Begin | Correct, task: str, randomness: str) -> Choice:
    operator = printable(order.operator.strip())
    return Choice(task=task, randomness=randomness, operator=operator, target=order.target, keys=order.keys)


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
