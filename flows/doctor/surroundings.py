"""What surrounds a run: environment variables, proxies, Prefect, MLflow, ports."""

from __future__ import annotations

import importlib.util
import os
import socket
import sqlite3
import urllib.request
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from urllib.parse import unquote, urlsplit

from flows.doctor.verdict import Verdict, ok, problem, warning
from flows.running.settings import PREFIX, RENAMED, RUNNER_VARIABLE, Settings
from flows.servers.addresses import HEALTH_SECONDS, LOOPBACK, PORTS
from flows.servers.environment import API_VARIABLE
from flows.servers.process import title
from juicer.errors import did_you_mean
from stages.runtime.connection import connect
from stages.tracking.destination import without_credentials

CONNECT_SECONDS = 3.0


def check_variables(settings: Settings) -> Iterator[Verdict]:
    """Variables of juicer's own name that nobody reads."""
    known = {PREFIX + name.upper() for name in Settings.model_fields}
    named = sorted(name for name in os.environ if name.startswith(PREFIX))
    unknown = [name for name in named if name not in known]
    for name in unknown:
        yield problem(
            f"environment variable {name} is not known{RENAMED.get(name) or did_you_mean(name, known)}", f"unset {name}"
        )
    if not unknown:
        yield ok(", ".join(named) if named else "no variable of juicer's is set; its defaults hold")


def check_proxies(settings: Settings) -> Iterator[Verdict]:
    """Whether a proxy would be asked for this machine's own servers."""
    proxies = {scheme: url for scheme, url in urllib.request.getproxies().items() if scheme != "no"}
    if not proxies:
        yield ok("no proxy is set")
        return
    shown = ", ".join(f"{scheme} by {without_credentials(url)}" for scheme, url in sorted(proxies.items()))
    if any(url.lower().startswith("socks") for url in proxies.values()) and not importlib.util.find_spec("socksio"):
        yield warning(f"a SOCKS proxy is set ({shown}) and the library for it is missing", "pip install socksio")
    elif urllib.request.proxy_bypass(LOOPBACK):
        yield ok(f"proxies are set ({shown}), and this machine's own servers are reached without them")
    else:
        yield problem(
            f"proxies are set ({shown}), for this machine's own servers too",
            f"set NO_PROXY={LOOPBACK},localhost and no_proxy to the same",
        )


def check_prefect(settings: Settings) -> Iterator[Verdict]:
    """Whether the Prefect server that the environment names answers."""
    url = os.environ.get(API_VARIABLE, "")
    if not url:
        remedy = f"set {API_VARIABLE}, or unset {RUNNER_VARIABLE}"
        if settings.cluster:
            yield problem("stages are to run on other machines, and no Prefect server is named", remedy)
        else:
            yield ok("no Prefect server is named: a run uses that of `juicer ui`, or starts one for its own length")
        return
    if reason := _refusal(url):
        yield problem(f"the Prefect server at '{url}' {reason}", f"start it, or unset {API_VARIABLE}")
    else:
        yield ok(f"the Prefect server at '{url}' takes connections")


def check_ports(settings: Settings) -> Iterator[Verdict]:
    """Whether the usual ports of ``juicer ui`` are free."""
    for name, port in PORTS.items():
        with socket.socket() as probe:
            probe.settimeout(CONNECT_SECONDS)
            in_use = probe.connect_ex((LOOPBACK, port)) == 0
        state = "in use: by a server of yours, or `juicer ui` takes another" if in_use else "free"
        yield ok(f"port {port}, {title(name)}'s usual one, is {state}")


def check_tracking(settings: Settings) -> Iterator[Verdict]:
    """Whether the place that records go to can be used."""
    uri = settings.tracking_uri
    scheme, shown = urlsplit(uri).scheme, without_credentials(uri)
    if not settings.tracks:
        yield ok("nothing is recorded in MLflow, as JUICER_TRACKING_URI says")
    elif not uri:
        yield _database(settings.folder / "mlflow.db")
    elif scheme in ("http", "https"):
        if reason := _refusal(uri):
            yield warning(
                f"the MLflow server at '{shown}' {reason}", "start it; until then records wait in the data folder"
            )
        else:
            yield ok(f"the MLflow server at '{shown}' takes connections")
    elif scheme == "sqlite":
        yield _database(Path(unquote(uri.removeprefix("sqlite:///"))))
    else:
        yield ok(f"records go to '{shown}', which was not tried")


def _database(path: Path) -> Verdict:
    if not path.exists():
        return ok(f"records will go to '{path}', which the first run makes")
    try:
        with closing(
            sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True, timeout=CONNECT_SECONDS)
        ) as tables:
            (count,) = tables.execute("select count(*) from runs").fetchone()
    except sqlite3.Error as error:
        return problem(f"MLflow's database '{path}' cannot be read: {error}", "move it aside; a new one is made")
    return ok(f"records go to '{path}', which holds {count} runs")


def _refusal(url: str) -> str:
    """Why nobody answers for an address, as the end of a sentence; empty if somebody does."""
    try:
        parts = urlsplit(url)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            return "is no address; write it as http://HOST:PORT/api"
        connect(url, HEALTH_SECONDS)
    except ValueError as error:
        return f"is no address ({error})"
    except OSError as error:
        return f"does not answer ({error.strerror or error})"
    return ""
