"""A Prefect server for one run, where none is running.

It is Prefect's own temporary server with two differences: an interrupt from the keyboard reaches the run only, which
then ends in order; and it ends with the run even if that is killed.
"""

from __future__ import annotations

import atexit
import os
import socket
import subprocess
import sys
import threading
import time
from urllib.error import URLError
from urllib.request import urlopen

from flows.services import LOOPBACK
from juicer.errors import ServiceUnavailable

POLL_SECONDS = 0.2
GRACE_SECONDS = 5.0


class TemporaryServer:
    """The server's process; starts at once, becomes ready while this process imports Prefect."""

    def __init__(self) -> None:
        """Start the process; it is stopped when this process exits."""
        # The socket is handed over, not its number: nobody else can answer in the server's place.
        listener = socket.create_server((LOOPBACK, 0), backlog=0)
        self.api_url = f"http://{LOOPBACK}:{listener.getsockname()[1]}/api"
        environment = {
            **os.environ,
            "PREFECT_UI_ENABLED": "0",
            "PREFECT__SERVER_EPHEMERAL": "1",
            "PREFECT__SERVER_FINAL": "1",
        }
        self._process = subprocess.Popen(
            [sys.executable, "-m", "flows.temporary_server", str(listener.fileno())],
            env=environment,
            pass_fds=[listener.fileno()],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            start_new_session=True,
        )
        listener.close()
        # Registered before Prefect is imported, so that Prefect can say its last words before the server goes.
        atexit.register(self.stop)

    def wait(self, seconds: float) -> None:
        """Wait until it answers.

        Raises:
            ServiceUnavailable: If it does not, or ends.
        """
        deadline = time.monotonic() + seconds
        while not self._answers():
            if self._process.poll() is not None:
                _, words = self._process.communicate()
                last = words.decode(errors="replace").strip().splitlines()[-1:] or ["it said nothing"]
                raise ServiceUnavailable(f"Prefect's temporary server did not start: {last[0]}")
            if time.monotonic() > deadline:
                raise ServiceUnavailable(
                    f"Prefect's temporary server did not answer within {seconds:.0f} s; "
                    "set JUICER_STARTUP_SECONDS to wait longer"
                )
            time.sleep(POLL_SECONDS)
        # From here on nobody reads what it says; a full pipe must not stop it.
        threading.Thread(target=self._drain, daemon=True).start()

    def stop(self) -> None:
        """End the process."""
        if self._process.poll() is None:
            self._process.terminate()
            try:
                self._process.wait(GRACE_SECONDS)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()

    def _answers(self) -> bool:
        try:
            with urlopen(f"{self.api_url}/health", timeout=POLL_SECONDS * 10) as response:
                return bool(response.status == 200)
        except (OSError, URLError):
            return False

    def _drain(self) -> None:
        for _ in self._process.stderr or ():
            pass


def _end_with_parent() -> None:
    sys.stdin.buffer.read()
    os._exit(1)


def main() -> None:
    """Serve on the socket whose number is the only argument, until the parent is gone."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    import uvicorn

    config = uvicorn.Config("prefect.server.api.server:create_app", factory=True, log_level="error", lifespan="on")
    uvicorn.Server(config).run([socket.socket(fileno=int(sys.argv[1]))])


if __name__ == "__main__":
    main()
