"""A real browser in tests: headless Chromium, told what to do over its own debugging protocol."""

from __future__ import annotations

import base64
import json
import shutil
import subprocess
import time
import urllib.request
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Self

from websockets.sync.client import ClientConnection, connect

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
STARTING_S = 60.0


class Chromium:
    """One browser with one page, of a profile of its own."""

    def __init__(self, profile: Path, size: tuple[int, int] = (1280, 800)) -> None:
        assert CHROMIUM, "there is no Chromium here"
        self._profile = profile
        self._process = subprocess.Popen(
            [
                CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking",
                "--no-first-run", "--remote-debugging-port=0", "--remote-allow-origins=*",
                f"--user-data-dir={profile}", f"--window-size={size[0]},{size[1]}", "about:blank",
            ],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )  # fmt: skip
        self._socket = self._connected()
        self._number = 0
        for domain in ("Page", "Runtime", "Network"):
            self.call(f"{domain}.enable")
        self.call("Emulation.setFocusEmulationEnabled", enabled=True)
        self.resize(*size)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _connected(self) -> ClientConnection:
        found = self._profile / "DevToolsActivePort"
        until = time.monotonic() + STARTING_S
        while time.monotonic() < until:
            try:
                port = int(found.read_text().splitlines()[0])
                with urllib.request.urlopen(f"http://127.0.0.1:{port}/json/list", timeout=5) as answer:
                    pages = [each for each in json.load(answer) if each["type"] == "page"]
                return connect(pages[0]["webSocketDebuggerUrl"], max_size=None, proxy=None)
            except (OSError, ValueError, IndexError):
                time.sleep(0.1)
        self._process.kill()
        raise TimeoutError("Chromium does not start")

    @property
    def pid(self) -> int:
        return self._process.pid

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Say something in the protocol and wait for the answer; events are passed over."""
        self._number += 1
        self._socket.send(json.dumps({"id": self._number, "method": method, "params": parameters}))
        while True:
            answer = json.loads(self._socket.recv(timeout=60))
            if answer.get("id") == self._number:
                assert "error" not in answer, answer
                return answer["result"]

    def goto(self, address: str) -> None:
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
            time.sleep(0.05)
        return value

    def key_down(self, code: str) -> None:
        self.call("Input.dispatchKeyEvent", type="rawKeyDown", code=code, key=_key(code))

    def key_up(self, code: str) -> None:
        self.call("Input.dispatchKeyEvent", type="keyUp", code=code, key=_key(code))

    def press(self, code: str) -> None:
        self.key_down(code)
        self.key_up(code)

    def hold(self, wanted: Iterable[str], held: set[str]) -> set[str]:
        """Hold these keys and no others; the second argument is what is held now."""
        wanted = set(wanted)
        for code in held - wanted:
            self.key_up(code)
        for code in wanted - held:
            self.key_down(code)
        return wanted

    def resize(self, width: int, height: int, scale: float = 1.0) -> None:
        self.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=scale, mobile=False
        )

    def dark(self, is_dark: bool) -> None:
        value = "dark" if is_dark else "light"
        self.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": value}])

    def screenshot(self, path: Path) -> None:
        data = self.call("Page.captureScreenshot", format="png")["data"]
        path.write_bytes(base64.b64decode(data))

    def close(self) -> None:
        self._socket.close()
        self._process.terminate()
        try:
            self._process.wait(20)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def _key(code: str) -> str:
    return code.removeprefix("Key").lower() if code.startswith("Key") else {"Space": " "}.get(code, code)
