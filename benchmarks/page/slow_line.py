"""A line to a port of this machine that takes its time, as a tunnel over ssh does: late, but whole and in order."""

from __future__ import annotations

import asyncio
import random
import threading
from contextlib import suppress
from typing import Self

_CHUNK_BYTES = 2**16


class SlowLine:
    """Listens on a port of its own; to be used in a ``with`` block.

    Attributes:
        port: Where it listens.
    """

    def __init__(self, delay_ms: float, jitter_ms: float = 0.0) -> None:
        """Listen.

        Args:
            delay_ms: How much later every byte arrives, in each direction.
            jitter_ms: Up to how much more, drawn anew for what arrives together. Nothing overtakes: as in TCP, what
                comes after something late is late as well.
        """
        self._delay_s, self._jitter_s = delay_ms / 1000, jitter_ms / 1000
        self._target = 0
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        self.port = asyncio.run_coroutine_threadsafe(self._listen(), self._loop).result()

    def lead_to(self, port: int) -> None:
        """Where connections go from now on."""
        self._target = port

    def __enter__(self) -> Self:
        """Be closed at the end."""
        return self

    def __exit__(self, *_: object) -> None:
        """Cut every connection."""
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()

    async def _listen(self) -> int:
        server = await asyncio.start_server(self._serve, "127.0.0.1", 0)
        return int(server.sockets[0].getsockname()[1])

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        there, back = await asyncio.open_connection("127.0.0.1", self._target)
        await asyncio.gather(self._pump(reader, back), self._pump(there, writer))

    async def _pump(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Carry bytes in one direction: what is on its way waits in a queue, in the order in which it came."""
        on_its_way: asyncio.Queue[tuple[float, bytes]] = asyncio.Queue()
        delivery = asyncio.create_task(self._deliver(on_its_way, writer))
        with suppress(ConnectionError):
            while data := await reader.read(_CHUNK_BYTES):
                due = self._loop.time() + self._delay_s + random.uniform(0, self._jitter_s)
                on_its_way.put_nowait((due, data))
        on_its_way.put_nowait((self._loop.time() + self._delay_s, b""))
        await delivery

    async def _deliver(self, on_its_way: asyncio.Queue[tuple[float, bytes]], writer: asyncio.StreamWriter) -> None:
        data = b"some"
        with suppress(ConnectionError):
            while data:
                due, data = await on_its_way.get()
                await asyncio.sleep(due - self._loop.time())
                writer.write(data)
                await writer.drain()
        writer.close()
