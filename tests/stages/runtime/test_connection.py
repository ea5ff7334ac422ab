"""Servers are reached as their clients reach them."""

from __future__ import annotations

import socket

import pytest

from stages.runtime.connection import connect


@pytest.fixture
def listening():
    """Port of this machine at which somebody listens."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server.getsockname()[1]


@pytest.fixture(autouse=True)
def no_proxies(monkeypatch):
    for name in ("http_proxy", "https_proxy", "all_proxy", "no_proxy"):
        monkeypatch.delenv(name, raising=False)
        monkeypatch.delenv(name.upper(), raising=False)


def test_a_server_is_connected_to_itself(listening):
    connect(f"http://127.0.0.1:{listening}/api", 1.0)
    with pytest.raises(OSError, match="refused"):
        connect("http://127.0.0.1:9", 1.0)


@pytest.mark.parametrize("form", ["http://127.0.0.1:{}", "127.0.0.1:{}"])
def test_what_only_a_proxy_reaches_is_asked_of_the_proxy(listening, monkeypatch, form):
    monkeypatch.setenv("https_proxy", form.format(listening))
    connect("https://mlflow.example.org", 1.0)
    monkeypatch.setenv("https_proxy", form.format(9))
    with pytest.raises(OSError, match="refused"):
        connect("https://mlflow.example.org", 1.0)
    monkeypatch.setenv("no_proxy", "127.0.0.1")
    connect(f"https://127.0.0.1:{listening}", 1.0)
