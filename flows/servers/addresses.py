"""Addresses and ports: whether a text is one, whether somebody answers there, which one is free."""

from __future__ import annotations

import errno
import socket
import urllib.request
from urllib.parse import urlsplit

from juicer.errors import ConfigError, ServiceUnavailable
from juicer.text import printable
from stages.runtime.connection import connect

LOOPBACK = "127.0.0.1"
PORTS = {"prefect": 4200, "mlflow": 5000}
"""The usual ones of both servers."""
HEALTH_SECONDS = 2.0
BACKLOG = 2048


def is_answering(url: str) -> bool:
    """Whether a request to an address succeeds."""
    try:
        with urllib.request.urlopen(url, timeout=HEALTH_SECONDS) as response:
            return bool(response.status == 200)
    except (OSError, ValueError):
        return False


def check_address(variable: str, url: str) -> None:
    """Refuse a text that names no web server.

    Raises:
        ConfigError: Naming the environment variable that holds it.
    """
    try:
        parts = urlsplit(url)
        names_server = parts.scheme in ("http", "https") and bool(parts.hostname) and parts.port != 0
    except ValueError:
        names_server = False
    if not names_server:
        raise ConfigError(
            f"environment variable {variable}: '{printable(url)}' is no address; write it as http://HOST:PORT/api"
        )


def check_reachable(name: str, url: str, remedy: str) -> None:
    """Refuse a server that nobody answers for.

    Raises:
        ServiceUnavailable: If no connection can be made.
    """
    try:
        connect(url, HEALTH_SECONDS)
    except OSError as error:
        reason = error.strerror or str(error)
        raise ServiceUnavailable(f"the {name} at '{url}' does not answer ({reason}); {remedy}") from None


def listen(wanted: int | None, preferred: int, name: str) -> socket.socket:
    """A socket that listens on loopback: on the wanted port or none, else on the preferred one if free, else on any.

    Whoever holds it keeps the port: nobody else can answer in the server's place.

    Raises:
        ServiceUnavailable: If the wanted port is in use, or not ours to take.
    """
    if wanted is not None:
        try:
            return listen_on(LOOPBACK, wanted)
        except OSError as error:
            problem = "is in use" if error.errno == errno.EADDRINUSE else f"cannot be had ({error.strerror})"
            raise ServiceUnavailable(
                f"port {wanted} for {name} {problem}; choose another one, or none to have one found"
            ) from None
    try:
        return listen_on(LOOPBACK, preferred)
    except OSError:
        return listen_on(LOOPBACK, 0)


def listen_on(host: str, port: int) -> socket.socket:
    """A socket that listens.

    Raises:
        OSError: If the port is in use, or this machine is not called so.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    return socket.create_server((host, port), family=family, backlog=BACKLOG)


def port_of(listener: socket.socket) -> int:
    """Port of a listening socket."""
    port: int = listener.getsockname()[1]
    return port
