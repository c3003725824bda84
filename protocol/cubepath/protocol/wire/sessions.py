"""Zenoh sessions: a router, clients to it, and no discovery.

The settings ensure that no client loses a message: BLOCK puts, one priority, a long wait before a
stalled transport is closed, no shared memory (its counters run out at about 350 clients). On one
host the link to a stopped process is kept for longer than any run waits; between hosts a link that
is silent for `LEASE_S` is closed, and its client connects anew, perhaps to another router. A
process that ends is noticed immediately all the same. A router cuts off a client that does not
read, and the client reconnects and asks for what it missed. Measured with eclipse-zenoh 1.10.
"""

import contextlib
import json
import re
import resource
import socket
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import zenoh

from cubepath.protocol.core.errors import CubepathError, InputError, OptionError
from cubepath.protocol.wire.credentials import GUEST, SCHEME, TLS, Credentials, settings_for

_BLOCKED = "transport/link/tx/queue/congestion_control/block/wait_before_close"
_STALL_US_MAX = 3_600_000_000
_STALL_US_AT_ROUTER = 1_000_000
"""How long a router waits for who does not read, and everybody else with it."""
_KEY_BYTES_MAX = 1 << 16
LEASE_S = 10.0
"""How long a session that says nothing is taken for alive, where a host may be cut off."""
_LEASE_S_ON_ONE_HOST = 3600.0
"""The same over a unix socket: longer than any run waits for a process that stands still."""
_FOR_SESSIONS = 24
"""Descriptors that a router and two clients need, with a few to spare."""
_FOR_A_PROCESS = 4
_POLL_S = 0.0005
_AGAIN_S = 0.1
_RETRY = {"period_init_ms": 1000, "period_max_ms": 1000, "period_increase_factor": 1}
"""How often a client whose router is gone looks for one."""
_OPEN_S = 10.0
"""After this time an attempt to connect is over."""
_TAKE_S = 1.0
"""After this time nothing takes a connection at an address."""
_GONE_S_MAX, _STILL_S_MAX = 10.0, 60.0
"""How long a part of a run tries to reach its router: one that is not there, or stands still."""
_PLACE = r"(?:\[[0-9a-fA-F:]+\]|[^/\s:\[\]#?;]+):[0-9]{1,5}"
_ENDPOINT = re.compile(rf"(?:tcp|tls)/{_PLACE}", re.ASCII)
_FROM = re.compile(rf"#bind={_PLACE}", re.ASCII)
"""At the end of where to connect to: from which address of this host, with port 0 for any."""
_EVERYWHERE = {"0.0.0.0": "127.0.0.1", "[::]": "[::1]"}  # noqa: S104 - looked for, not listened on


def _config(mode: str, endpoint: str, **settings: object) -> zenoh.Config:
    config = zenoh.Config()
    lease_s = _LEASE_S_ON_ONE_HOST if endpoint.startswith(SCHEME) else LEASE_S
    base: dict[str, object] = {
        "mode": mode,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,
        "adminspace/enabled": True,
        "transport/shared_memory/enabled": False,
        "transport/link/tx/lease": round(1000 * lease_s),
        "transport/unicast/open_timeout": round(1000 * _OPEN_S),
        _BLOCKED: _STALL_US_MAX,
    }
    for key, value in (base | settings).items():
        config.insert_json5(key, json.dumps(value))
    return config


def check_descriptors(processes: int = 0, files: int = 0) -> None:
    """Check that there are enough file descriptors; CubepathError says how many it takes.

    They are for a router, two clients, a client in each of `processes` other processes, and this
    many files. Without them zenoh would panic.
    """
    needed = _FOR_SESSIONS + _FOR_A_PROCESS * processes + files
    most = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    if most == resource.RLIM_INFINITY:
        return
    try:
        taken = len(list(Path("/dev/fd").iterdir())) - 1  # one of them is the listing itself
    except OSError:
        taken = most  # none is left even to list them
    if most - taken < needed:
        raise CubepathError(
            f"too few open files are allowed: {most}, expected at least {taken + needed}"
            " (ulimit -n)"
        )


def endpoints_in(text: str) -> list[str]:
    """Return the endpoints of linked routers, separated by commas: a client has one at a time."""
    return text.split(",")


def check_endpoints(text: str) -> None:
    """Check endpoints to connect to, each as `check_endpoint` does; InputError if one is wrong."""
    for endpoint in endpoints_in(text):
        check_endpoint(endpoint, connect=True)


def check_endpoint(endpoint: str, *, connect: bool = False) -> None:
    """Check that an endpoint is ``tcp/HOST:PORT`` or ``tls/HOST:PORT``; InputError if not.

    One to connect to may end in ``#bind=HOST:PORT``, which says from where.
    """
    place, sharp, _ = endpoint.partition("#")
    bound = not sharp or (connect and _FROM.fullmatch(endpoint.removeprefix(place)) is not None)
    if not _ENDPOINT.fullmatch(place) or not bound:
        raise InputError(
            f"endpoint {endpoint}: expected tcp/HOST:PORT or tls/HOST:PORT, as tcp/127.0.0.1:7447"
        )


def check_links(endpoint: str, links: Sequence[str]) -> None:
    """Check where a router that listens at an endpoint is to connect to; not itself: InputError."""
    for each in links:
        check_endpoint(each, connect=True)
        if each.partition("#")[0] == endpoint:
            raise OptionError(f"connect={each}: this router itself, expected another one")


def open_router(
    endpoint: str, guard: Mapping[str, Any], message_bytes_max: int, links: Sequence[str] = ()
) -> tuple[zenoh.Session, str]:
    """Open a router at an endpoint, port 0 for a free one; return it with where it listens.

    It connects to the routers at `links`, whenever they come or come back: linked routers serve as
    one. Of two, one alone may connect to the other (zenoh 1.10 panics). `guard` has the settings by
    which it lets clients in and lets them speak. A message of more bytes, its key beside it, is
    dropped before it is put together. Raises InputError if the router cannot listen there. It
    should have a separate process, as `Router` gives it: the receiving threads of zenoh are shared
    by all sessions of a process, and under a flood they would wait for each other.
    """
    settings: Mapping[str, Any] = {
        "listen/endpoints": [endpoint],
        "connect/endpoints": list(links),
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
        _BLOCKED: _STALL_US_AT_ROUTER,
        "transport/link/rx/max_message_size": message_bytes_max + _KEY_BYTES_MAX,
        **guard,
    }
    try:
        session = zenoh.open(_config("router", endpoint, **settings))
    except zenoh.ZError as error:
        why = ", it is in use" if "already in use" in str(error) else ""
        raise InputError(f"endpoint {endpoint}: cannot listen there{why}") from None
    if endpoint.startswith(SCHEME) or not endpoint.endswith(":0"):
        return session, endpoint
    # The system chooses the port; the router's own admin space tells which.
    scheme = endpoint.partition("/")[0]
    for reply in session.get(f"@/{session.info.zid()}/*"):
        if reply.ok is None:
            continue
        found = json.loads(reply.ok.payload.to_string())
        for locator in found.get("locators", ()) if isinstance(found, dict) else ():
            if str(locator).startswith(f"{scheme}/"):
                port = str(locator).partition("?")[0].rpartition(":")[2]
                return session, f"{endpoint.removesuffix('0')}{port}"
    session.close()
    raise CubepathError("the zenoh router did not report the port it listens on")


def reachable(endpoint: str) -> str:
    """Return where a client on this machine finds the router that listens at an endpoint."""
    scheme, _, rest = endpoint.partition("/")
    host, _, port = rest.rpartition(":")
    return f"{scheme}/{_EVERYWHERE[host]}:{port}" if host in _EVERYWHERE else endpoint


def is_reachable(endpoint: str, patience_s: float) -> bool:
    """Return whether a router takes connections at ``tcp/`` or ``tls/`` within this many seconds.

    A router that stands still counts: the system takes them for it.
    """
    deadline = time.monotonic() + patience_s
    while True:
        left_s = deadline - time.monotonic()
        timeout_s = max(_AGAIN_S, min(_TAKE_S, left_s))
        if any(_takes(each, timeout_s) for each in endpoints_in(endpoint)):
            return True
        if left_s <= _AGAIN_S:
            return False
        time.sleep(_AGAIN_S)


def _takes(endpoint: str, timeout_s: float) -> bool:
    place, _, own = endpoint.partition("#bind=")
    with contextlib.suppress(OSError, UnicodeError):  # the latter for names that no host has
        socket.create_connection(
            _address(place.partition("/")[2]),
            timeout=timeout_s,
            source_address=_address(own) if own else None,
        ).close()
        return True
    return False


def _address(place: str) -> tuple[str, int]:
    host, _, port = place.rpartition(":")
    return host.strip("[]"), int(port)


def open_client(
    endpoint: str, patience_s: float | None = 0.0, *, credentials: Credentials = GUEST
) -> zenoh.Session:
    """Open a client session to the router at `endpoint`; CubepathError if it is not there.

    Of several linked routers (`endpoints_in`) it has the first that answers, and another when that
    one dies.

    It is tried for this many seconds: a router that has died may be on its way back. None is as
    long as the parts of a run try: 10 s, and a minute if the router is there and stands still.
    Without `credentials` the session may listen at a private router, and publish nothing.
    InputError if the endpoint takes a certificate and there is none.
    """
    settings: Mapping[str, Any] = {
        "listen/endpoints": [],
        "connect/endpoints": endpoints_in(endpoint),
        "connect/retry": _RETRY,
        **settings_for(endpoint, credentials),
    }
    began = time.monotonic()
    while True:
        tried = time.monotonic()
        try:
            return zenoh.open(_config("client", endpoint, **settings))
        except zenoh.ZError:
            now = time.monotonic()
            # A router that is absent, or turns the session away, makes the attempt fail
            # immediately.
            silent = now - tried >= _OPEN_S
            most = patience_s
            if most is None:
                most = _STILL_S_MAX if silent else _GONE_S_MAX
            if now - began >= most:
                why = "no answer"
                if silent:
                    why += f" within {_OPEN_S:g} s"
                elif not endpoint.startswith("tcp/"):
                    what = "certificate" if endpoint.startswith(TLS) else "password"
                    why += f", or {credentials.name} and its {what} are not known there"
                raise CubepathError(f"no zenoh router at {endpoint}: {why}") from None
        time.sleep(_AGAIN_S)


def routers_of(session: zenoh.Session) -> tuple[str, ...]:
    """Return the ids of the routers that a client is connected to: one, or none."""
    return tuple(sorted(str(each) for each in session.info.routers_zid()))


def put(session: zenoh.Session, key: str, data: bytes) -> None:
    """Put without dropping: a full queue makes the sender wait."""
    session.put(key, data, congestion_control=zenoh.CongestionControl.BLOCK)


def subscribe(
    session: zenoh.Session, key: str, enqueue: Callable[[zenoh.Sample], None]
) -> zenoh.Subscriber[None]:
    """Subscribe with a direct callback, which must only put into a queue: zenoh waits for it."""
    return session.declare_subscriber(key, zenoh.handlers.Callback(enqueue, indirect=False))


def watch(
    session: zenoh.Session, key: str, tell: Callable[[str, bool], None]
) -> zenoh.Subscriber[None]:
    """Report liveliness tokens, the present ones first: the key, and whether it is there now.

    `tell` is a direct callback, as for `subscribe`.
    """

    def changed(sample: zenoh.Sample) -> None:
        tell(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

    callback = zenoh.handlers.Callback(changed, indirect=False)
    return session.liveliness().declare_subscriber(key, callback, history=True)


def publisher(session: zenoh.Session, key: str) -> zenoh.Publisher:
    """Declare a publisher whose puts never drop, and never come back to its own session."""
    return session.declare_publisher(
        key,
        congestion_control=zenoh.CongestionControl.BLOCK,
        allowed_destination=zenoh.Locality.REMOTE,
    )


def is_heard(declared: zenoh.Publisher) -> bool:
    """Return whether a session knows of a subscriber elsewhere to what a publisher puts.

    A router's admin space would also tell how many there are, but to ask it while somebody declares
    anything can lock up the router permanently (zenoh 1.10; eclipse-zenoh/zenoh, pull request
    2619).
    """
    # An object, which is always true; zenoh's stub declares a bool.
    return bool(cast("Any", declared.matching_status).matching)


def wait_for_ear(
    ear: zenoh.Session, session: zenoh.Session, key: str, patience_s: float = 10.0
) -> None:
    """Wait until what a session puts comes to all that another, `ear`, has subscribed to so far.

    A declaration and a put travel over different links, in no order: a message put before the
    subscriber is known is lost. That a publisher is heard is no sign of it, as others may
    subscribe: so the ear puts a liveliness token on `key`, which arrives after what it declared
    before. CubepathError if it does not.
    """
    deadline = time.monotonic() + patience_s
    token = ear.liveliness().declare_token(key)
    try:
        while all(reply.ok is None for reply in session.liveliness().get(key)):
            if time.monotonic() > deadline:
                raise CubepathError(f"no token on {key} within {patience_s:.0f} s")
            time.sleep(_POLL_S)
    finally:
        token.undeclare()
