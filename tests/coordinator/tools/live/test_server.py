"""What the server of a live page lets in, and what it refuses, over real sockets."""

import json
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from http.client import HTTPConnection
from pathlib import Path
from typing import Any

import pytest

from cubepath.coordinator.tools.live import server as module
from cubepath.coordinator.tools.live.feed import Feed
from cubepath.coordinator.tools.live.server import CLIENTS_MAX, HOST, Server
from cubepath.coordinator.tools.live.watching import RoundPacer
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.scenes.specs import scene_from_spec
from processes.watched_pages import watched


@pytest.fixture
def served() -> Iterator[tuple[Server, RoundPacer]]:
    """Serve the page of a run that has not begun."""
    feed, pace = Feed(scene_from_spec("hex:n=3")), RoundPacer()
    feed.tell(pace.state)
    server = Server(feed, pace.order)
    try:
        yield server, pace
    finally:
        server.leave(0)
        feed.close()
    assert server.clients == 0


def ask(
    server: Server, what: str = "", method: str = "GET", body: bytes | None = None, **headers: Any
) -> tuple[int, bytes, dict[str, str]]:
    """Ask for a part of the page, and return the status, the body and the headers."""
    connection = HTTPConnection(HOST, server.server_port, timeout=10)
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    path = what if what.startswith("/") else f"/{server.token}/{what}"
    connection.request(method, path, body, named)
    answer = connection.getresponse()
    found = answer.status, answer.read(), dict(answer.getheaders())
    connection.close()
    return found


def order(server: Server, told: object, **headers: Any) -> tuple[int, bytes]:
    body = told if isinstance(told, bytes) else json.dumps(told).encode()
    headers = {"Content_Type": "application/json", **headers}
    return ask(server, "orders", "POST", body, **headers)[:2]


def test_the_page_says_what_it_may_do(served: tuple[Server, RoundPacer]) -> None:
    """Nothing but its own scripts and its own server, nothing kept, and no word to others."""
    server, _ = served
    status, page, headers = ask(server)
    assert (status, page) == (200, server.page)
    policy = headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy
    assert "frame-ancestors 'none'" in policy
    assert policy.count("'sha256-") == page.count(b"<script>") + 1
    assert "unsafe-inline" not in policy.partition("style-src")[0]
    assert headers["Cache-Control"] == "no-store"
    assert headers["Referrer-Policy"] == "no-referrer"
    assert not [name for name in headers if name.startswith("Access-Control")]
    for host in (f"localhost:{server.server_port}", server.address.split("/")[2]):
        assert ask(server, Host=host, Origin=f"http://{host}")[0] == 200


@pytest.mark.parametrize("method", ["GET", "POST", "HEAD", "OPTIONS", "BREW"])
def test_without_the_token_there_is_nothing(served: tuple[Server, RoundPacer], method: str) -> None:
    """Not even a word on what there would be with it."""
    server, pace = served
    token = server.token
    wrong = ("/", "/events", "/orders", f"/{token[:-1]}/", f"/{token}", f"/{token}x/orders", "//")
    for path in wrong:
        status, body, _ = ask(server, path, method)
        assert status == 403
        assert body.count(b"\n") <= 1
        assert token.encode() not in body
    assert not pace.state["paused"]


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "evil.example"},
        {"Host": "evil.example:{port}"},
        {"Host": "127.0.0.1"},
        {"Host": "127.0.0.1:{port}.evil.example"},
        {"Host": ""},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": "http://127.0.0.1:1"},
        {"Origin": "https://127.0.0.1:{port}"},
        {"Sec_Fetch_Site": "cross-site"},
        {"Sec_Fetch_Site": "same-site"},
    ],
)
def test_other_hosts_and_sites_are_refused(
    served: tuple[Server, RoundPacer], headers: dict[str, str]
) -> None:
    """Though they know the token: a name that is made to point here, and pages of others."""
    server, pace = served
    given: Any = {name: text.format(port=server.server_port) for name, text in headers.items()}
    assert order(server, {"order": "pause"}, **given)[0] == 403
    assert ask(server, "events", **given)[0] == 403
    assert not pace.state["paused"]


@pytest.mark.parametrize(
    ("told", "status"),
    [
        (b"", 400),
        (b"{", 400),
        (b"[]", 400),
        (b'"pause"', 400),
        (b"\xff\xfe", 400),
        (b"[" * 1000, 400),
        ({"order": None}, 400),
        ({"order": ["pause"]}, 400),
        ({"order": "halt"}, 400),
        ({"order": "rate", "value": -1}, 400),
        ({"order": "step", "value": 10**9}, 400),
        (b" " * 1025, 413),
        ({"order": "pause"}, 200),
    ],
)
def test_what_is_no_order_is_refused_in_a_line(
    served: tuple[Server, RoundPacer], told: object, status: int
) -> None:
    """And has no effect; an order is carried out."""
    server, pace = served
    found, body = order(server, told)
    assert (found, body.count(b"\n")) == (status, 1)
    assert pace.state["paused"] == (status == 200)


def test_orders_come_as_json_by_post_alone(served: tuple[Server, RoundPacer]) -> None:
    """Forms, which pages of others may send, are refused, and other methods, and unknown parts."""
    server, pace = served
    pause = b'{"order": "pause"}'
    form = {"Content_Type": "application/x-www-form-urlencoded"}
    assert ask(server, "orders", "POST", pause, **form)[0] == 415
    assert ask(server, "orders", "POST", pause, Content_Type="text/plain")[0] == 415
    assert ask(server, "orders")[0] == 405
    assert ask(server, "", "POST", pause)[0] == 405
    assert ask(server, "events", "PUT", pause)[0] == 405
    assert ask(server, "other")[0] == 404
    assert ask(server, "../etc/passwd")[0] in {403, 404}
    assert not pace.state["paused"]


def test_garbage_and_silence_hold_nobody_up(
    served: tuple[Server, RoundPacer], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Who sends no request is cut off, who is one too many is told so, and others are served."""
    server, _ = served
    with socket.create_connection((HOST, server.server_port), timeout=10) as client:
        client.sendall(b"<script>\r\n\r\n")
        assert client.recv(1 << 16) == b"400 Bad Request\n"
    for garbage in (b"\x16\x03\x01\x00", b"GET\r\n\r\n", b"GET / HTTP/9.9\r\n\r\n", b"a" * 70_000):
        address = HOST, server.server_port
        with socket.create_connection(address, timeout=10) as client, suppress(ConnectionError):
            client.sendall(garbage + b"\r\n\r\n")
            client.shutdown(socket.SHUT_WR)
            while client.recv(1 << 16):
                pass
    assert ask(server)[0] == 200
    monkeypatch.setattr(module, "ASKING_S_MAX", 0.3)
    silent = [
        socket.create_connection((HOST, server.server_port), timeout=10)
        for _ in range(CLIENTS_MAX + 1)
    ]
    assert silent[-1].recv(100).startswith(b"HTTP/1.1 503 ")
    assert [client.recv(100) for client in silent[:-1]] == [b""] * CLIENTS_MAX
    for client in silent:
        client.close()
    while ask(server)[0] == 503:  # who was cut off has its place until its thread has ended
        time.sleep(0.01)
    assert ask(server)[0] == 200


def test_who_reads_nothing_holds_nobody_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Events wait for who is slow until it is cut off, and others get them all."""
    monkeypatch.setattr(module._Handler, "timeout", 0.3)
    found = watched("hex:n=5", tmp_path)
    steps = [tuple(step) for step in found.shown.steps]
    feed = Feed(found.shown.scene)
    server = Server(feed, None)
    slow = socket.create_connection((HOST, server.server_port), timeout=10)
    slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1024)
    slow.sendall(
        f"GET /{server.token}/events HTTP/1.1\r\nHost: {HOST}:{server.server_port}\r\n\r\n".encode()
    )
    feed.give(0, steps)
    feed.tell({"long": "x" * 10_000_000})
    feed.end({"ended": "goal", "error": None})
    status, events, _ = ask(server, "events")
    assert status == 200
    assert events.endswith(b'data: {"ended":"goal","error":null}\n\n')
    assert order(server, {"order": "pause"})[0] == 409
    server.leave()
    feed.close()
    slow.close()
    assert [each.name for each in threading.enumerate() if "cubepath" in each.name] == []


def test_a_port_that_is_taken_is_told(served: tuple[Server, RoundPacer]) -> None:
    """In a line that names it and says why, without numbers of errors; as is one that is none."""
    server, _ = served
    with pytest.raises(InputError, match=r": Address already in use$"):
        Server(Feed(scene_from_spec("hex:n=3")), None, port=server.server_port)
    for port in (server.server_port, 70_000):
        with pytest.raises(InputError, match=f"cannot listen at 127.0.0.1:{port}"):
            Server(Feed(scene_from_spec("hex:n=3")), None, port=port)
