"""A small HTTP server for the page of one run, on this machine only.

A client that knows the token in its address may watch the run and pause it. Requests that name
another host, or come from another site's page, are refused: neither a host name that points here
nor a page that guesses can reach a run.
"""

import contextlib
import hmac
import json
import re
import secrets
import socket
import sys
import threading
import time
from base64 import b64encode
from collections.abc import Callable
from hashlib import sha256
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from cubepath.coordinator.tools.live.feed import Feed, FeedPosition
from cubepath.coordinator.tools.viewing.pages import page_text
from cubepath.protocol.core.errors import InputError

HOST = "127.0.0.1"
CLIENTS_MAX = 32
"""The most connections at one time; later ones are told to try again."""
BODY_MAX = 1024
"""Bytes of an order; http.server bounds the rest of a request."""
ASKING_S_MAX = 10.0
"""A request that has not come by then, or an answer that nobody takes, ends its connection."""
_QUIET_S = 5.0
_LEAVE_S = 2.0
_LOOK_S = 0.05

Orders = Callable[[str, object], None]


class Server(ThreadingHTTPServer):
    """Serves a page, its events and its orders, from threads that end with it."""

    daemon_answering = True
    block_on_close = False
    request_queue_size = CLIENTS_MAX

    def __init__(self, feed: Feed, orders: Orders | None, *, port: int = 0) -> None:
        """Listen; port 0 is any free one. InputError, and the feed ends, if it cannot be had."""
        page = page_text(feed.document, live=True)
        self.page = page.encode()
        self.policy = policy_of(page)
        self.feed = feed
        self.orders = orders
        self.token = secrets.token_urlsafe(24)
        self._lock = threading.Lock()
        self._clients: dict[socket.socket, float] = {}
        self._answering: dict[socket.socket, threading.Thread] = {}
        try:
            super().__init__((HOST, port), _Handler)
        except (OSError, OverflowError) as error:
            feed.close()
            raise InputError(f"live: cannot listen at {HOST}:{port}: {_reason(error)}") from None
        self.hosts = {f"{name}:{self.server_port}" for name in (HOST, "localhost")}
        self._thread = threading.Thread(
            target=self.serve_forever, args=(_LOOK_S,), name="cubepath-live", daemon=True
        )
        self._thread.start()

    @property
    def address(self) -> str:
        """Return where the page is: a client that has this may watch."""
        return f"http://{HOST}:{self.server_port}/{self.token}/"

    @property
    def clients(self) -> int:
        """Return how many connections there are."""
        with self._lock:
            return len(self._clients)

    def leave(self, wait_s: float = _LEAVE_S) -> None:
        """End, once all viewers have received everything, or after this many seconds at most."""
        until = time.monotonic() + wait_s
        while self.clients and time.monotonic() < until:
            time.sleep(_LOOK_S)
        self.shutdown()
        self._thread.join()
        self.server_close()
        with self._lock:
            left = dict(self._answering)
            for client in self._clients:
                _cut(client)
        for thread in left.values():
            thread.join(_LEAVE_S)

    def stays(self, client: socket.socket) -> None:
        """Let a client stay whose request has come, however long its answer takes."""
        with self._lock:
            if client in self._clients:
                self._clients[client] = float("inf")

    # What http.server calls.

    def server_bind(self) -> None:
        """Bind without asking anybody for the name of this machine."""
        self.socket.bind(self.server_address)
        self.server_address = self.socket.getsockname()
        self.server_name, self.server_port = HOST, int(self.server_address[1])

    def process_request(self, request: Any, client_address: Any) -> None:
        """Answer in a separate thread, unless there are too many."""
        with self._lock:
            room = len(self._clients) < CLIENTS_MAX
            if room:
                self._clients[request] = time.monotonic() + ASKING_S_MAX
        if not room:
            with contextlib.suppress(OSError):
                request.setblocking(False)
                request.send(b"HTTP/1.1 503 Busy\r\nContent-Length: 0\r\nConnection: close\r\n\r\n")
            self.shutdown_request(request)
            return
        thread = threading.Thread(
            target=self.process_request_thread, args=(request, client_address), daemon=True
        )
        with self._lock:
            self._answering[request] = thread
        thread.start()

    def shutdown_request(self, request: Any) -> None:
        """Forget a client that has its answer."""
        super().shutdown_request(request)
        with self._lock:
            self._clients.pop(request, None)
            self._answering.pop(request, None)

    def service_actions(self) -> None:
        """Cut off those who have asked for nothing for long."""
        now = time.monotonic()
        with self._lock:
            for client, until in self._clients.items():
                if now > until:
                    _cut(client)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing of a client that has gone; all else is an error of this program."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    """One request: the page, its events, or an order."""

    server: Server  # pyright: ignore[reportIncompatibleVariableOverride]
    protocol_version = "HTTP/1.1"
    server_version = "cubepath"
    sys_version = ""
    timeout = ASKING_S_MAX

    def do_GET(self) -> None:
        """Answer with the page, or with its events."""
        what = self._asked()
        if what == "":
            self._answer(HTTPStatus.OK, self.server.page, "text/html; charset=utf-8")
        elif what == "events":
            if self._is_from_here():
                self._feed()
        elif what == "orders":
            self.send_error(HTTPStatus.METHOD_NOT_ALLOWED, "expected POST")
        elif what is not None:
            self.send_error(HTTPStatus.NOT_FOUND, "no such page")

    def do_POST(self) -> None:
        """Carry out an order."""
        what = self._asked()
        if what is None:
            return
        if what != "orders":
            known = what in {"", "events"}
            code = HTTPStatus.METHOD_NOT_ALLOWED if known else HTTPStatus.NOT_FOUND
            self.send_error(code, "expected GET" if known else "no such page")
        elif self._is_from_here():
            self._order()

    def _other(self) -> None:
        if self._asked() is not None:
            self.send_error(HTTPStatus.METHOD_NOT_ALLOWED, "expected GET or POST")

    def __getattr__(self, name: str) -> Callable[[], None]:
        """Answer every other method alike; http.server looks for one of this name."""
        if name.startswith("do_"):
            return self._other
        raise AttributeError(name)

    def _asked(self) -> str | None:
        """Return what of this page is asked for; None if nothing may be, which is answered."""
        server = self.server
        hosts = self.headers.get_all("Host", [])
        if len(hosts) != 1 or hosts[0].lower() not in server.hosts:
            self.send_error(HTTPStatus.FORBIDDEN, "another host")
            return None
        found = re.fullmatch(r"/([^/?]*)/([^?]*)", self.path)
        given = b"" if found is None else found[1].encode("utf-8", "replace")
        if not hmac.compare_digest(given, server.token.encode()) or found is None:
            self.send_error(
                HTTPStatus.FORBIDDEN, "no token: expected the address as it was printed"
            )
            return None
        origins = self.headers.get_all("Origin", [])
        if any(
            origin.lower() not in {f"http://{host}" for host in server.hosts} for origin in origins
        ):
            self.send_error(HTTPStatus.FORBIDDEN, "another origin")
            return None
        return found[2]

    def _is_from_here(self) -> bool:
        """Return whether a browser says that the page itself asks; a program says nothing."""
        if self.headers.get("Sec-Fetch-Site", "same-origin") in {"same-origin", "none"}:
            return True
        self.send_error(HTTPStatus.FORBIDDEN, "another site")
        return False

    def _order(self) -> None:
        length = self.headers.get("Content-Length", "")
        if re.fullmatch(r"[0-9]{1,6}", length) is None or "Transfer-Encoding" in self.headers:
            self.send_error(HTTPStatus.LENGTH_REQUIRED, "expected Content-Length")
            return
        if int(length) > BODY_MAX:
            self.send_error(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"expected {BODY_MAX} bytes")
            return
        # A page of another site cannot send this type without being allowed to.
        if self.headers.get_content_type() != "application/json":
            self.send_error(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "expected application/json")
            return
        try:
            document = json.loads(self.rfile.read(int(length)))
            order, value = document["order"], document.get("value")
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
            self.send_error(HTTPStatus.BAD_REQUEST, 'expected {"order": ..., "value": ...}')
            return
        if self.server.orders is None:
            self.send_error(HTTPStatus.CONFLICT, "this run can only be watched")
            return
        try:
            self.server.orders(order, value)
        except InputError as error:
            self.send_error(HTTPStatus.BAD_REQUEST, str(error))
            return
        self._answer(HTTPStatus.OK, b"{}\n", "application/json")

    def _feed(self) -> None:
        """Send events as they come, until there are no more or nobody takes them."""
        last = self.headers.get("Last-Event-ID", "")
        place = FeedPosition(events=int(last) if re.fullmatch(r"[0-9]{1,15}", last) else 0)
        self._head(HTTPStatus.OK, "text/event-stream; charset=utf-8")
        self.end_headers()
        self.server.stays(self.connection)
        while (events := self.server.feed.next(place, _QUIET_S)) is not None:
            # An empty line of comment shows whether anybody is there.
            for event in events or [b":\n\n"]:
                self.wfile.write(event)

    def _answer(self, code: HTTPStatus, data: bytes, kind: str) -> None:
        self._head(code, kind)
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(data)

    def _head(self, code: HTTPStatus, kind: str) -> None:
        self.close_connection = True
        self.send_response(code)
        for name, value in (
            ("Content-Type", kind),
            ("Connection", "close"),
            ("Cache-Control", "no-store"),
            ("Content-Security-Policy", self.server.policy),
            ("Cross-Origin-Opener-Policy", "same-origin"),
            ("Cross-Origin-Resource-Policy", "same-origin"),
            ("Referrer-Policy", "no-referrer"),
            ("X-Content-Type-Options", "nosniff"),
            ("X-Frame-Options", "DENY"),
        ):
            self.send_header(name, value)

    # What http.server calls.

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:  # noqa: ARG002 - as http.server calls it
        """Answer in one line; what a request says is not repeated."""
        status = HTTPStatus(code)
        if not self.command:  # what http.server says of garbage has the garbage in it
            message = None
        line = f"{status.value} {status.phrase}" + (f": {message}" if message else "")
        self._answer(status, line.encode("ascii", "replace") + b"\n", "text/plain; charset=utf-8")

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002
        """Log nothing: the address has the token."""


def _reason(error: OSError | OverflowError) -> str:
    return (error.strerror if isinstance(error, OSError) else None) or str(error)


def policy_of(page: str) -> str:
    """Return what a page may do: run its own scripts, by their digests, and ask its own server."""
    scripts = re.findall(r"<script(?: data-live)?>(.*?)</script>", page, re.DOTALL)
    digests = (b64encode(sha256(each.encode()).digest()).decode() for each in scripts)
    return "; ".join(
        [
            "default-src 'none'",
            "script-src " + " ".join(f"'sha256-{digest}'" for digest in digests),
            "style-src 'unsafe-inline'",
            "img-src data:",
            "connect-src 'self'",
            "base-uri 'none'",
            "form-action 'none'",
            "frame-ancestors 'none'",
        ]
    )


def _cut(client: socket.socket) -> None:
    with contextlib.suppress(OSError):
        client.shutdown(socket.SHUT_RDWR)
