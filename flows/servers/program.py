"""What the process of a server runs: Prefect's or MLflow's application, behind the guard.

Called as ``python -m flows.servers.program NAME SOCKET`` by whoever wants it to end with itself: it does when its
standard input is closed.
"""

from __future__ import annotations

import os
import signal
import socket
import sys
import threading
from collections.abc import Callable, Collection
from pathlib import Path
from typing import TYPE_CHECKING

from filelock import FileLock

from flows.servers.addresses import port_of
from flows.servers.guard import Credentials, Guard, host_names, loopback_names
from juicer.errors import ConfigError, JuicerError

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

NAMES_VARIABLE = "JUICER_ALLOWED_HOSTS"
PREFECT_PASSWORD = "PREFECT_SERVER_API_AUTH_STRING"
SHUTDOWN_SECONDS = 3
MLFLOW_USER, MLFLOW_PASSWORD = "MLFLOW_TRACKING_USERNAME", "MLFLOW_TRACKING_PASSWORD"


def serve(name: str, listener: socket.socket) -> None:
    """Serve until a signal ends it; everything else is in the environment.

    Raises:
        ConfigError: If the server would ask for no password.
    """
    import uvicorn

    hosts = loopback_names(port_of(listener)) | host_names(os.environ.get(NAMES_VARIABLE, "").split(","))
    app = {"prefect": _prefect, "mlflow": _mlflow}[name](hosts)
    config = uvicorn.Config(
        app,
        log_level="error",
        lifespan="on",
        server_header=False,
        # A page that is open somewhere must not hold up the end.
        timeout_graceful_shutdown=SHUTDOWN_SECONDS,
    )
    uvicorn.Server(config).run([listener])


def _prefect(hosts: Collection[str]) -> ASGIApp:
    _require(PREFECT_PASSWORD)
    from prefect.server.api.server import create_app
    from prefect.settings import get_current_settings
    from sqlalchemy.engine import make_url

    app: ASGIApp = create_app(final=True)
    database = get_current_settings().server.database.connection_url
    url = make_url(database.get_secret_value() if database else "")
    if url.get_backend_name() == "sqlite" and url.database and ":memory:" not in url.database:
        app = OneStartAtATime(app, Path(f"{url.database}.lock"))
    # Prefect asks for the password itself, websockets included.
    return Guard(app, hosts)


def _mlflow(hosts: Collection[str]) -> ASGIApp:
    credentials = Credentials(_require(MLFLOW_USER), _require(MLFLOW_PASSWORD))
    from stages.tracking.server import create_app

    return Guard(create_app(hosts), hosts, credentials)


def _require(variable: str) -> str:
    value = os.environ.get(variable, "")
    if not value:
        raise ConfigError(f"a server without a password is not started; set {variable}")
    return value


class OneStartAtATime:
    """ASGI application whose start-up holds a lock.

    Prefect's servers make and change the tables of their database then, and get in each other's way.
    """

    def __init__(self, app: ASGIApp, lock: Path) -> None:
        """Wrap an application."""
        self._app = app
        self._lock = FileLock(lock, thread_local=False)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve a connection, or start up."""
        if scope["type"] != "lifespan":
            await self._app(scope, receive, send)
            return

        async def receiving() -> Message:
            message = await receive()
            if message["type"] == "lifespan.startup":
                # Nothing is served yet that could be kept waiting.
                self._lock.acquire()
            return message

        async def sending(message: Message) -> None:
            if message["type"].startswith("lifespan.startup."):
                self._lock.release()
            await send(message)

        await self._app(scope, receiving, sending)


def end_with_parent(end: Callable[[], None]) -> None:
    """Call ``end`` when the other end of standard input is closed, as it is at the latest when its holder dies."""

    def wait() -> None:
        # Not through `sys.stdin`: its lock would be missed when the interpreter ends in the meantime.
        while os.read(0, 1024):
            pass
        end()

    threading.Thread(target=wait, daemon=True).start()


def _end_all() -> None:
    """End this process and all that it has started; it leads a group of its own."""
    os.killpg(os.getpgrp(), signal.SIGKILL)


def main() -> None:
    """Serve on the socket whose number is the second argument, until the parent is gone."""
    end_with_parent(_end_all)
    try:
        serve(sys.argv[1], socket.socket(fileno=int(sys.argv[2])))
    except JuicerError as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
