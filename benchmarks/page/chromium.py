"""A real browser: headless Chromium, told what to do over its own debugging protocol."""

from __future__ import annotations

import base64
import json
import shutil
import subprocess
import time
import urllib.request
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Self

from websockets.sync.client import connect

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
STARTING_S = 60.0

_SHIFT = 8
_NAMES = {"Space": " ", "ShiftLeft": "Shift", "ShiftRight": "Shift"}
_NUMBERS = {
    "Tab": 9, "Enter": 13, "Shift": 16, "Escape": 27, "ArrowLeft": 37, "ArrowUp": 38, "ArrowRight": 39, "ArrowDown": 40,
}  # fmt: skip


class Chromium:
    """One browser with one page, of a profile of its own.

    Attributes:
        debugger: Address of its debugging socket, for whoever wants to look on.
    """

    def __init__(self, profile: Path, size: tuple[int, int] = (1280, 800), options: Sequence[str] = ()) -> None:
        """Start it with an empty page."""
        assert CHROMIUM, "there is no Chromium here"
        self._profile = profile
        self._process = subprocess.Popen(
            [
                CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking",
                "--no-first-run", "--remote-debugging-port=0", f"--user-data-dir={profile}",
                f"--window-size={size[0]},{size[1]}", *options, "about:blank",
            ],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )  # fmt: skip
        self.debugger = self._found()
        self._socket = connect(self.debugger, max_size=None, proxy=None, ping_interval=None)
        self._number = 0
        for domain in ("Page", "Runtime", "Network"):
            self.call(f"{domain}.enable")
        self.call("Emulation.setFocusEmulationEnabled", enabled=True)
        self.resize(*size)

    def __enter__(self) -> Self:
        """Be closed at the end."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close it."""
        self.close()

    def _found(self) -> str:
        found = self._profile / "DevToolsActivePort"
        until = time.monotonic() + STARTING_S
        while time.monotonic() < until:
            try:
                port = int(found.read_text().splitlines()[0])
                with urllib.request.urlopen(f"http://127.0.0.1:{port}/json/list", timeout=5) as answer:
                    pages = [each for each in json.load(answer) if each["type"] == "page"]
                return str(pages[0]["webSocketDebuggerUrl"])
            except (OSError, ValueError, IndexError):
                time.sleep(0.1)
        self._process.kill()
        raise TimeoutError("Chromium does not start")

    @property
    def pid(self) -> int:
        """Number of its process."""
        return self._process.pid

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Say something in the protocol and wait for the answer; events are passed over."""
        self._number += 1
        self._socket.send(json.dumps({"id": self._number, "method": method, "params": parameters}))
        while True:
            answer: dict[str, Any] = json.loads(self._socket.recv(timeout=120))
            if answer.get("id") == self._number:
                assert "error" not in answer, answer
                result: dict[str, Any] = answer["result"]
                return result

    def open(self, address: str) -> None:
        """Open a page as if its address had been typed."""
        self.call("Page.navigate", url=address)
        self.until("document.readyState === 'complete' && location.href !== 'about:blank'")

    def evaluate(self, expression: str) -> Any:
        """Value of an expression in the page; promises are waited for."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def until(self, expression: str, seconds: float = 60.0) -> Any:
        """Wait until an expression is true."""
        end = time.monotonic() + seconds
        while not (value := self.evaluate(expression)):
            assert time.monotonic() < end, f"never true: {expression}"
            time.sleep(0.02)
        return value

    def key_down(self, code: str, *, shift: bool = False) -> None:
        """Press a key, as a keyboard does, by its ``KeyboardEvent.code``, and hold it."""
        event = _key_event(code, shift)
        kind = "keyDown" if "text" in event else "rawKeyDown"
        self.call("Input.dispatchKeyEvent", type=kind, **event)

    def key_up(self, code: str, *, shift: bool = False) -> None:
        """Let go of it."""
        self.call("Input.dispatchKeyEvent", type="keyUp", **_key_event(code, shift))

    def press(self, code: str, *, shift: bool = False) -> None:
        """Press and release a key."""
        self.key_down(code, shift=shift)
        self.key_up(code, shift=shift)

    def hold(self, wanted: Iterable[str], held: set[str]) -> set[str]:
        """Hold these keys and no others; the second argument is what is held now."""
        wanted = set(wanted)
        for code in held - wanted:
            self.key_up(code)
        for code in wanted - held:
            self.key_down(code)
        return wanted

    def type(self, text: str) -> None:
        """Type into what has the focus."""
        self.call("Input.insertText", text=text)

    def resize(self, width: int, height: int, scale: float = 1.0) -> None:
        """Give the page another size [CSS pixels]."""
        self.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=scale, mobile=False
        )

    def dark(self, is_dark: bool) -> None:
        """Prefer dark colours, or light ones."""
        value = "dark" if is_dark else "light"
        self.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": value}])

    def screenshot(self, path: Path) -> None:
        """Write what is seen as PNG."""
        data = self.call("Page.captureScreenshot", format="png")["data"]
        path.write_bytes(base64.b64decode(data))

    def close(self) -> None:
        """End it."""
        self._socket.close()
        self._process.terminate()
        try:
            self._process.wait(20)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def _key_event(code: str, shift: bool) -> dict[str, Any]:
    key = _NAMES.get(code) or (code[-1].lower() if code[:-1] in ("Key", "Digit") else code)
    event: dict[str, Any] = {"key": key, "code": code, "modifiers": _SHIFT if shift else 0}
    if number := _NUMBERS.get(key, ord(key.upper()) if len(key) == 1 else 0):
        event["windowsVirtualKeyCode"] = number
    if text := "\r" if key == "Enter" else key if len(key) == 1 else "":
        event["text"] = text
    return event
