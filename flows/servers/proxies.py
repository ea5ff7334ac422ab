"""Proxies are for the network beyond this machine; juicer's own servers on it are reached directly."""

from __future__ import annotations

import os
from collections.abc import MutableMapping

LOOPBACK_NAMES = ("127.0.0.1", "localhost", "::1")
_VARIABLES = ("no_proxy", "NO_PROXY")


def bypass_proxies_on_loopback(environment: MutableMapping[str, str] = os.environ) -> None:
    """Add this machine's own names to what no proxy is asked for, in this process and in those that it starts."""
    for variable in _VARIABLES:
        # Libraries differ in which of the two they read first; what either says holds for both.
        said = [environment.get(name, "") for name in (variable, *_VARIABLES)]
        named = [name.strip() for text in said for name in text.split(",") if name.strip()]
        environment[variable] = ",".join(dict.fromkeys([*named, *LOOPBACK_NAMES]))
