"""``juicer server``: one of the two servers in the foreground, set up by its makers' own variables."""

from __future__ import annotations

import os

from flows.running.settings import read_settings
from flows.servers.addresses import PORTS, listen_on
from flows.servers.environment import API_VARIABLE, quiet_environment
from flows.servers.program import NAMES_VARIABLE, serve
from juicer.errors import ConfigError, ServiceUnavailable, did_you_mean
from juicer.text import printable


def serve_one(name: str, host: str, port: int | None) -> None:
    """Serve until a signal ends it.

    Raises:
        ConfigError: If there is no such server, or a variable that it needs is not set.
        ServiceUnavailable: If its port is in use.
        TrackingError: If MLflow's database cannot be used.
    """
    if name not in PORTS:
        raise ConfigError(f"there is no server '{printable(name)}'{did_you_mean(name, PORTS)}")
    settings = read_settings()
    for variable, value in quiet_environment(settings).items():
        os.environ.setdefault(variable, value)
    os.environ[NAMES_VARIABLE] = settings.allowed_hosts
    if name == "prefect":
        # A server is not its own client.
        os.environ.pop(API_VARIABLE, None)
        os.environ.setdefault("PREFECT_SERVER_UI_API_URL", "/api")
        os.environ["PREFECT_LOGGING_SERVER_LEVEL"] = "WARNING"
    port = PORTS[name] if port is None else port
    try:
        listener = listen_on(host, port)
    except OSError as error:
        where = f"'{printable(host)}', port {port},"
        raise ServiceUnavailable(f"{where} cannot be had: {error.strerror or error}") from None
    with listener:
        serve(name, listener)
