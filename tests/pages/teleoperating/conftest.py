"""The socket of the pages, without a browser."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack

import pytest
from starlette.testclient import TestClient

from juicer.pages.application import create_application
from juicer.pages.workplace import Workplace
from tests.pages.teleoperating.talking import Page


@pytest.fixture
def application(store, tmp_path):
    return create_application(Workplace(store, tmp_path))


@pytest.fixture
def client(application) -> Iterator[TestClient]:
    with TestClient(application) as client:
        yield client


@pytest.fixture
def connect(client) -> Iterator[Callable[[], Page]]:
    with ExitStack() as sockets:

        def open_page() -> Page:
            return Page(sockets.enter_context(client.websocket_connect("/teleop/live")))

        yield open_page


@pytest.fixture
def page(connect) -> Page:
    return connect()
