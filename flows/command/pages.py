"""``juicer pages``: the pages for people, on loopback until Ctrl-C."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from typing import TYPE_CHECKING

from flows.running.data_folder import open_store, prepare_folder
from flows.running.services import Pages, announce, find_pages, find_services, only_one
from flows.running.settings import Settings, read_settings
from flows.servers.addresses import LOOPBACK, listen, port_of
from flows.servers.guard import Guard, host_names, loopback_names
from flows.servers.secret import credentials_of
from flows.terminal.output import say, say_json
from juicer.errors import ServiceUnavailable

if TYPE_CHECKING:
    from starlette.types import ASGIApp

PORT = 8000
SHUTDOWN_SECONDS = 3


def serve_pages(port: int | None, as_json: bool) -> None:
    """Serve until Ctrl-C.

    Raises:
        ServiceUnavailable: If the pages are served already, the port is in use, or the data folder cannot be written.
    """
    import uvicorn

    from juicer.pages.limits import MOST_MESSAGE_BYTES

    settings = read_settings()
    prepare_folder(settings)
    with ExitStack() as stack:
        if not stack.enter_context(only_one(settings.folder, Pages)):
            where = find_pages(settings.folder)
            shown = f": {where}/?token={token_of(settings)}" if where else ""
            raise ServiceUnavailable(f"the pages are already served{shown}")
        listener = stack.enter_context(listen(port, PORT, "juicer's pages"))
        address, token = f"http://{LOOPBACK}:{port_of(listener)}", token_of(settings)
        server = uvicorn.Server(
            uvicorn.Config(
                pages(settings, port_of(listener), token),
                log_level="error",
                server_header=False,
                ws_max_size=MOST_MESSAGE_BYTES,
                # Images do not get smaller by it, only later.
                ws_per_message_deflate=False,
                # A page that is open somewhere must not hold up the end.
                timeout_graceful_shutdown=SHUTDOWN_SECONDS,
            )
        )
        stack.enter_context(announce(settings.folder, Pages(address)))
        if as_json:
            say_json({"pages": address, "token": token})
        else:
            say(f"pages    {address}/?token={token}")
            say("open it in a browser of this machine, or through `ssh -L`; Ctrl-C ends it")
        with suppress(KeyboardInterrupt):
            server.run([listener])


def pages(settings: Settings, port: int, token: str) -> ASGIApp:
    """The pages behind all that guards them."""
    from juicer.pages.access import Access
    from juicer.pages.application import create_application
    from juicer.pages.workplace import Workplace

    def servers() -> Mapping[str, str]:
        services = find_services(settings.folder)
        return {"MLflow": services.mlflow, "Prefect": services.prefect} if services else {}

    workplace = Workplace(open_store(settings), settings.folder, settings.workers, servers)
    hosts = loopback_names(port) | host_names(settings.allowed_hosts.split(","))
    return Guard(Access(create_application(workplace), token), hosts)


def token_of(settings: Settings) -> str:
    """The token of a data folder: always the same, so that browsers need it once; tells nothing of the password."""
    password = credentials_of(settings.folder).password
    return hashlib.sha256(f"pages {password}".encode()).hexdigest()[:32]
