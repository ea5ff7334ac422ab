"""From a key to the screen: what an operator feels, in headless Chromium with real rendering.

    python -m benchmarks.teleoperation [--presses 60] [--delay-ms 40 --jitter-ms 15]

A delay is added in each direction by half of it, by a proxy between browser and server, as a tunnel over ssh would.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import random
import tempfile
import threading
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from tests.pages.teleoperating.chromium import Chromium
from tests.pages.teleoperating.conftest import serving
from tests.pages.teleoperating.driving import begin

TICKS_S = 0.01


def cpu_s(pid: int) -> float:
    """Seconds of a processor that a process and its children have used."""
    used = 0.0
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if pid in (int(stat.parent.name), int(fields[1])):
            used += (int(fields[11]) + int(fields[12])) * TICKS_S
    return used


class SlowLine:
    """A line to a port of this machine, with half of a delay in each direction; nothing overtakes."""

    def __init__(self, port: int, delay_ms: float, jitter_ms: float) -> None:
        self._port, self._delay_s, self._jitter_s = port, delay_ms / 2000, jitter_ms / 2000
        self._loop = asyncio.new_event_loop()
        threading.Thread(target=self._loop.run_forever, daemon=True).start()
        self.port = asyncio.run_coroutine_threadsafe(self._listen(), self._loop).result()

    async def _listen(self) -> int:
        server = await asyncio.start_server(self._serve, "127.0.0.1", 0)
        return int(server.sockets[0].getsockname()[1])

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        there, back = await asyncio.open_connection("127.0.0.1", self._port)
        await asyncio.gather(self._pump(reader, back), self._pump(there, writer))

    async def _pump(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        due = 0.0
        while data := await reader.read(2**16):
            due = max(due, self._loop.time() + self._delay_s + random.uniform(0, self._jitter_s))
            self._loop.call_at(due, writer.write, data)
        writer.close()


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--presses", type=int, default=60)
    parser.add_argument("--delay-ms", type=float, default=0.0)
    parser.add_argument("--jitter-ms", type=float, default=15.0)
    options = parser.parse_args()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(ignore_cleanup_errors=True)))
        server = stack.enter_context(serving(folder))
        address = server.teleop
        if options.delay_ms:
            served = int(server.address.rpartition(":")[2])
            port = SlowLine(served, options.delay_ms, options.jitter_ms).port
            address = address.replace(f":{served}/", f":{port}/")
        browser = stack.enter_context(Chromium(folder / "profile"))
        print(json.dumps(measure(browser, server.process.pid, address, options.presses), indent=1))


def measure(browser: Chromium, server: int, address: str, presses: int) -> dict[str, float]:
    """Press keys at random moments, and read how long each took."""
    begin(browser, address)
    browser.press("KeyA")
    time.sleep(3)
    heard, moved, rates = [], [], []
    cpu, began = (cpu_s(server), cpu_s(browser.pid)), time.monotonic()
    dropped = browser.evaluate("teleop.figures.dropped")
    for number in range(presses):
        key = ("KeyA", "KeyD")[number % 2]
        browser.key_down(key)
        time.sleep(0.5 + random.uniform(0, 0.1))
        browser.key_up(key)
        time.sleep(0.15 + random.uniform(0, 0.1))
        figures = browser.evaluate("teleop.figures")
        heard.append(figures["latencies"][-1])
        moved.append(figures["motions"][-1])
        rates.append(figures["framesPerSecond"])
    seconds = time.monotonic() - began
    return {
        "key_to_paint_ms_median": round(float(np.median(heard)), 1),
        "key_to_paint_ms_p95": round(float(np.percentile(heard, 95)), 1),
        "key_to_motion_ms_median": round(float(np.median(moved)), 1),
        "key_to_motion_ms_p95": round(float(np.percentile(moved, 95)), 1),
        "frames_per_second": round(float(np.mean(rates)), 1),
        "frames_dropped": browser.evaluate("teleop.figures.dropped") - dropped,
        "server_cpu_percent": round(100 * (cpu_s(server) - cpu[0]) / seconds, 1),
        "browser_cpu_percent": round(100 * (cpu_s(browser.pid) - cpu[1]) / seconds, 1),
    }


if __name__ == "__main__":
    main()
