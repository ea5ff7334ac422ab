"""The guard answers its own pages and programs of this machine, and nobody else."""

from __future__ import annotations

import asyncio

import pytest

from flows.servers.guard import Credentials, Guard, host_name, host_names, loopback_names

HOSTS = loopback_names(4200) | host_names(["https://prefect.example.org", " other:81 ", ""])
CREDENTIALS = Credentials("juicer", "s3cret")
OWN = {"host": "127.0.0.1:4200"}
PAGE = {"sec-fetch-site": "cross-site", "sec-fetch-mode": "navigate", "sec-fetch-dest": "document"}


async def careless(scope, receive, send):
    """A server that answers everything, and permits everybody to read it."""
    if scope["type"] == "websocket":
        await send({"type": "websocket.accept"})
        return
    headers = [
        (b"Access-Control-Allow-Origin", b"*"),
        (b"X-Frame-Options", b"ALLOWALL"),
        (b"Content-Security-Policy", b"default-src 'self'"),
    ]
    await send({"type": "http.response.start", "status": 200, "headers": headers})
    await send({"type": "http.response.body", "body": b"answer"})


def ask(headers, method="GET", path="/", kind="http", credentials=None, extensions=()):
    pairs = headers.items() if isinstance(headers, dict) else headers
    scope = {
        "type": kind,
        "path": path,
        "headers": [(name.encode(), value.encode("latin-1")) for name, value in pairs],
        "extensions": {name: {} for name in extensions},
    }
    if kind == "http":
        scope["method"] = method
    sent = []

    async def send(message):
        sent.append(message)

    asyncio.run(Guard(careless, HOSTS, credentials)(scope, None, send))
    return sent


def status(*arguments, **keywords):
    return ask(*arguments, **keywords)[0]["status"]


@pytest.mark.parametrize(
    "host",
    ["127.0.0.1:4200", "localhost:4200", "LOCALHOST:4200", "[::1]:4200", "prefect.example.org", "other:81"],
)
def test_own_names_are_answered(host):
    assert status({"host": host}) == 200


@pytest.mark.parametrize(
    "host",
    [
        "evil.example:4200",
        "127.0.0.1",
        "127.0.0.1:4201",
        "127.0.0.2:4200",
        "localhost.:4200",
        "localhost.evil.example:4200",
        "evil.example@127.0.0.1:4201",
        "prefect.example.org:8080",
        "",
        "//",
        "[::1:4200",
        "[::ffff:127.0.0.1]:4200",
    ],
)
def test_other_names_are_refused(host):
    assert status({"host": host}) == 403


def test_a_host_name_that_is_missing_or_given_twice_is_refused():
    assert status({}) == 403
    assert status([("host", "127.0.0.1:4200"), ("host", "127.0.0.1:4200")]) == 403


@pytest.mark.parametrize("method", ["GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS", "TRACE"])
@pytest.mark.parametrize(
    "origin",
    ["https://evil.example", "null", "", "http://127.0.0.1:8000", "http://localhost", "127.0.0.1:4200", "http://["],
)
def test_other_origins_are_refused_whatever_the_method(method, origin):
    assert status({**OWN, "origin": origin}, method=method) == 403


def test_own_pages_are_answered():
    for origin in ("http://127.0.0.1:4200", "http://localhost:4200", "https://prefect.example.org"):
        assert status({**OWN, "origin": origin, "sec-fetch-site": "same-origin"}, method="PATCH") == 200


def test_two_origins_are_refused():
    assert status([*OWN.items(), ("origin", "http://127.0.0.1:4200"), ("origin", "http://127.0.0.1:4200")]) == 403


@pytest.mark.parametrize("site", ["cross-site", "same-site", "nonsense"])
def test_what_a_browser_says_comes_from_another_site_is_refused(site):
    assert status({**OWN, "sec-fetch-site": site}) == 403
    assert status({**OWN, "sec-fetch-site": site, "sec-fetch-mode": "no-cors", "sec-fetch-dest": "image"}) == 403


def test_a_link_from_elsewhere_opens_a_page_but_sends_nothing_and_opens_no_frame():
    assert status({**OWN, **PAGE}) == 200
    assert status({**OWN, **PAGE}, method="POST") == 403
    assert status({**OWN, **PAGE, "sec-fetch-dest": "iframe"}) == 403
    assert status({**OWN, **PAGE, "sec-fetch-dest": "object"}) == 403


def test_websockets_are_guarded_alike():
    assert ask(OWN, kind="websocket") == [{"type": "websocket.accept"}]
    refused = ask({**OWN, "origin": "https://evil.example"}, kind="websocket")
    assert refused[0]["type"] == "websocket.close"
    spoken = ask({"host": "evil.example:4200"}, kind="websocket", extensions=["websocket.http.response"])
    assert [message["type"] for message in spoken] == ["websocket.http.response.start", "websocket.http.response.body"]
    assert spoken[0]["status"] == 403


def test_a_refusal_is_a_sentence():
    start, body = ask({"host": "evil.example"})
    assert dict(start["headers"])[b"content-type"].startswith(b"text/plain")
    assert body["body"] == b"this server does not answer to that host name; JUICER_ALLOWED_HOSTS can add names\n"


@pytest.mark.parametrize(
    "given",
    [
        *(None, "", "Basic", "Basic !", "Bearer s3cret"),
        *(Credentials("juicer", "wrong").header.decode(), "Basic \xff", "\xff x"),
    ],
)
def test_without_the_password_nothing_is_answered(given):
    headers = OWN if given is None else {**OWN, "authorization": given}
    (start, _) = ask(headers, credentials=CREDENTIALS)
    assert start["status"] == 401
    assert dict(start["headers"])[b"www-authenticate"].startswith(b"Basic ")


def test_the_password_is_asked_for_after_the_origin_and_not_for_health():
    told = {**OWN, "authorization": CREDENTIALS.header.decode()}
    assert status(told, credentials=CREDENTIALS) == 200
    assert status({**told, "origin": "https://evil.example"}, credentials=CREDENTIALS) == 403
    assert status(OWN, path="/health", credentials=CREDENTIALS) == 200
    assert status(OWN, path="/health", method="POST", credentials=CREDENTIALS) == 401
    assert status(OWN, path="/health/", credentials=CREDENTIALS) == 401
    assert status({"host": "evil.example"}, path="/health", credentials=CREDENTIALS) == 403


def test_no_permission_for_others_leaves_the_server():
    start, _ = ask(OWN)
    names = [name.lower() for name, _ in start["headers"]]
    assert not [name for name in names if name.startswith(b"access-control-")]
    assert names.count(b"x-frame-options") == 1
    assert (b"x-frame-options", b"SAMEORIGIN") in start["headers"]
    # Its own policy is kept beside ours: browsers keep to both.
    assert (b"Content-Security-Policy", b"default-src 'self'") in start["headers"]
    assert any(b"frame-ancestors 'self'" in value for _, value in start["headers"])


def test_names_and_addresses_are_the_same_to_the_guard():
    assert host_name("https://Prefect.example.org/pages") == "prefect.example.org"
    assert host_name("prefect:4200") == "prefect:4200"
    assert host_name("http://prefect.example.org:80") == "prefect.example.org"
    assert host_names(["", " "]) == frozenset()


def test_the_port_that_goes_without_saying_is_left_out_by_browsers():
    assert loopback_names(80) == {"127.0.0.1", "localhost", "[::1]"}
