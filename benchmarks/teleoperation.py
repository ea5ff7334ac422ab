"""From a key to the screen: what an operator feels, in headless Chromium with real rendering.

    python -m benchmarks.teleoperation [--presses 60] [--delay-ms 20 --jitter-ms 10]

A delay is added in each direction, by a line between browser and server that is as slow as a tunnel over ssh.
"""

from __future__ import annotations

import argparse
import json
import random
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from benchmarks.page.chromium import Chromium
from benchmarks.page.driving import COUNT_PAUSES, begin
from benchmarks.page.server import serving
from benchmarks.page.slow_line import SlowLine

TICKS_S = 0.01
COUNTED = "JSON.stringify([teleop.figures.dropped, teleop.status.step])"


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


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--presses", type=int, default=60)
    parser.add_argument("--delay-ms", type=float, default=0.0, help="in each direction")
    parser.add_argument("--jitter-ms", type=float, default=0.0, help="up to so much more, drawn anew again and again")
    options = parser.parse_args()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(ignore_cleanup_errors=True)))
        line = stack.enter_context(SlowLine(options.delay_ms, options.jitter_ms))
        server = stack.enter_context(serving(folder, JUICER_ALLOWED_HOSTS=f"127.0.0.1:{line.port}"))
        line.lead_to(server.port)
        browser = stack.enter_context(Chromium(folder / "profile"))
        seen = server.through(line.port) if options.delay_ms or options.jitter_ms else server
        print(json.dumps(measure(browser, server.process.pid, seen.teleop, options.presses), indent=1))


def measure(browser: Chromium, server: int, address: str, presses: int) -> dict[str, float]:
    """Press keys at random moments, and read how long each took."""
    begin(browser, address)
    browser.press("KeyA")
    time.sleep(3)
    heard, moved, rates = [], [], []
    browser.evaluate(COUNT_PAUSES)
    cpu, began = (cpu_s(server), cpu_s(browser.pid)), time.monotonic()
    dropped, steps = json.loads(browser.evaluate(COUNTED))
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
    dropped_by_now, steps_by_now = json.loads(browser.evaluate(COUNTED))
    return {
        "key_to_paint_ms_median": round(float(np.median(heard)), 1),
        "key_to_paint_ms_p95": round(float(np.percentile(heard, 95)), 1),
        "key_to_motion_ms_median": round(float(np.median(moved)), 1),
        "key_to_motion_ms_p95": round(float(np.percentile(moved, 95)), 1),
        "frames_per_second": round(float(np.mean(rates)), 1),
        "frames_dropped": dropped_by_now - dropped,
        "steps_per_second": round((steps_by_now - steps) / seconds, 2),
        "pauses": browser.evaluate("teleop.pauses"),
        "server_cpu_percent": round(100 * (cpu_s(server) - cpu[0]) / seconds, 1),
        "browser_cpu_percent": round(100 * (cpu_s(browser.pid) - cpu[1]) / seconds, 1),
    }


if __name__ == "__main__":
    main()
