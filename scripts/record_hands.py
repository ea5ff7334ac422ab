"""Record the page of teleoperation while scripted hands drive one_leg, for README.md, as an animated image.

MUJOCO_GL=egl python -m scripts.record_hands [--output docs/images/hands.webp]
"""

from __future__ import annotations

import argparse
import base64
import io
import json
import tempfile
import threading
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Self

from PIL import Image
from websockets.sync.client import connect

from benchmarks.page.chromium import Chromium
from benchmarks.page.driving import begin, drive
from benchmarks.page.hands import Hands
from benchmarks.page.server import serving

SIZE = (1360, 850)
SHOWN = (800, 500)
"""Pixels of the animation."""
SPEED = 4
"""How many times faster than it was it is shown."""
FRAME_S = 0.125
LAST_S = 2.5
"""How long the end stays."""
FIRST_S = 0.5
"""What is left out at the beginning, when not every image has arrived."""


class Onlooker:
    """Keeps what a browser shows, as often as it changes, without a word to whoever steers it."""

    def __init__(self, browser: Chromium) -> None:
        """Connect."""
        self.seen: list[tuple[float, bytes]] = []
        self._socket = connect(browser.debugger, max_size=None, proxy=None, ping_interval=None)
        self._thread = threading.Thread(target=self._look, daemon=True)

    def __enter__(self) -> Self:
        """Begin to look."""
        self._say("Page.enable")
        self._say("Page.startScreencast", format="jpeg", quality=92, everyNthFrame=2)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Look no more."""
        self._say("Page.stopScreencast")
        self._socket.close()
        self._thread.join()

    def _say(self, method: str, **parameters: object) -> None:
        self._socket.send(json.dumps({"id": 1, "method": method, "params": parameters}))

    def _look(self) -> None:
        for text in self._socket:
            told = json.loads(text)
            if told.get("method") == "Page.screencastFrame":
                self.seen.append((time.monotonic(), base64.b64decode(told["params"]["data"])))
                self._say("Page.screencastFrameAck", sessionId=told["params"]["sessionId"])


def main() -> None:
    """Drive until an episode is a success, and write what was seen of it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("docs/images/hands.webp"))
    options = parser.parse_args()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(ignore_cleanup_errors=True)))
        server = stack.enter_context(serving(folder))
        browser = stack.enter_context(Chromium(folder / "profile", SIZE))
        begin(browser, server.teleop)
        browser.evaluate("document.querySelector('#show-numbers').click()")  # they come all the same
        onlooker = stack.enter_context(Onlooker(browser))
        for number in range(10):
            onlooker.seen.clear()
            if drive(browser, Hands("one_leg", number), 300).success:
                break
        browser.until("teleop.status.kept[0].verification.verdict === 'verified'", 120)
        time.sleep(1)  # the next scene is drawn
        browser.screenshot(folder / "last.png")
        last = (folder / "last.png").read_bytes()
    write(options.output, onlooker.seen, last)


def write(path: Path, seen: list[tuple[float, bytes]], last: bytes) -> None:
    """Write an animation of moments at equal distances, and the last one."""
    start, end = seen[0][0] + FIRST_S, seen[-1][0]
    frames, index = [], 0
    for number in range(int((end - start) / (SPEED * FRAME_S)) + 1):
        while index + 1 < len(seen) and seen[index + 1][0] <= start + number * SPEED * FRAME_S:
            index += 1
        frames.append(scaled(seen[index][1]))
    frames.append(scaled(last))
    durations = [int(1000 * FRAME_S)] * (len(frames) - 1) + [int(1000 * LAST_S)]
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=durations, loop=0, quality=60, method=6)


def scaled(image: bytes) -> Image.Image:
    """An image in the size of the animation."""
    return Image.open(io.BytesIO(image)).convert("RGB").resize(SHOWN, Image.Resampling.LANCZOS)


if __name__ == "__main__":
    main()
