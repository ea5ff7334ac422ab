"""Whether a server can be reached, in as long as a user waits gladly."""

from __future__ import annotations

import socket
from urllib.parse import urlsplit
from urllib.request import getproxies, proxy_bypass


def connect(url: str, timeout_s: float) -> None:
    """Make a connection to whatever listens at an address, or to the proxy that clients ask for it, and end it.

    Raises:
        OSError: If none can be made.
    """
    parts = urlsplit(url)
    proxy = getproxies().get(parts.scheme, "")
    if proxy and parts.hostname and not proxy_bypass(parts.hostname):
        parts = urlsplit(proxy if "://" in proxy else f"http://{proxy}")
    port = parts.port or (443 if parts.scheme == "https" else 80)
    socket.create_connection((parts.hostname or "127.0.0.1", port), timeout=timeout_s).close()
