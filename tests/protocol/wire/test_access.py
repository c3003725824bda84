"""Who may speak on which keys of a private router: real sessions, one for each name."""

from __future__ import annotations

import time
from collections.abc import Iterator

import pytest
import zenoh

from cubepath.protocol.wire.access import access_list
from cubepath.protocol.wire.credentials import COORDINATOR
from cubepath.protocol.wire.router import Router
from cubepath.protocol.wire.sessions import open_client
from ears import Ear
from elsewhere import soon

pytestmark = pytest.mark.slow

RUN = "cubepath/0123456789ab"
OWN = ("ready", "reports", "observations", "waiting", "again", "turns", "rest")
LED = ("go/coordinator", "go/process_0", "reset/process_0", "acts/process_0", "summary/coordinator")
HEARD_S = 10.0


@pytest.fixture(scope="module")
def router() -> Iterator[Router]:
    """Return a router that knows two processes and two keepers."""
    with Router(processes=2, keepers=2) as found:
        yield found


def keys_of(process: int) -> list[str]:
    """Return the keys of a process."""
    name = f"process_{process}"
    regions = (f"{RUN}/to/0,-1/{name}", f"{RUN}/ask/1/{name}")
    return [*(f"{RUN}/{kind}/{name}" for kind in OWN), *regions]


def keys_of_keeper(keeper: int) -> list[str]:
    """Return the keys of a keeper."""
    kinds = ("pass/1", "tell/0", "shows/0,-1", "moved", "tail")
    return [f"{RUN}/{kind}/keeper_{keeper}" for kind in kinds]


@pytest.mark.parametrize("name", ["guest", "process_0", "process_1", "keeper_0", COORDINATOR])
def test_everyone_speaks_on_own_keys_alone(router: Router, name: str) -> None:
    """A guest on none, a process on its own, and the coordinator on all of a run."""
    own = {
        "guest": [],
        "process_0": keys_of(0),
        "process_1": keys_of(1),
        "keeper_0": keys_of_keeper(0),
    }
    led = [f"{RUN}/{topic}" for topic in LED]
    everything = [*keys_of(0), *keys_of(1), *keys_of_keeper(0), *keys_of_keeper(1), *led]
    asked = [*everything, "elsewhere/go/coordinator"]
    expected = own.get(name, everything)
    with (
        open_client(router.endpoint) as listener,
        open_client(router.endpoint, credentials=router.credentials(name)) as speaker,
    ):
        assert Ear(listener).hears(speaker, asked, len(expected)) == expected


def test_only_the_coordinator_gives_orders_and_only_to_who_they_are_for(router: Router) -> None:
    """A process asks for its own; what a guest would answer, or ask, goes nowhere."""

    def session(name: str) -> zenoh.Session:
        return open_client(router.endpoint, credentials=router.credentials(name))

    def answers(to: zenoh.Session, key: str) -> list[str]:
        replies = to.get(key, timeout=HEARD_S)
        return [reply.ok.payload.to_string() for reply in replies if reply.ok is not None]

    def reply(said: str) -> zenoh.handlers.Callback[zenoh.Query]:
        return zenoh.handlers.Callback(
            lambda query: query.reply(str(query.key_expr), said), indirect=False
        )

    with session(COORDINATOR) as one, session("process_0") as asks, session("guest") as guest:
        orders = one.declare_queryable(f"{RUN}/orders/*", reply("orders"))
        fake = guest.declare_queryable(f"{RUN}/orders/*", reply("fake"))
        soon(lambda: answers(asks, f"{RUN}/orders/process_0") == ["orders"], "no orders")
        assert answers(asks, f"{RUN}/orders/process_1") == []
        with open_client(router.endpoint) as other:
            assert answers(other, f"{RUN}/orders/process_0") == []
        fake.undeclare()
        orders.undeclare()


def alive(session: zenoh.Session) -> list[str]:
    """Return the keys of the tokens of runs."""
    replies = session.liveliness().get("cubepath/*/alive/*", timeout=HEARD_S)
    return [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]


def test_who_is_alive_is_not_for_others_to_say(router: Router) -> None:
    """Each declares a token of its own name; everyone is told."""
    names = ("guest", "process_0", "process_1", COORDINATOR)
    sessions = [
        open_client(router.endpoint, credentials=router.credentials(name)) for name in names
    ]
    try:
        tokens = [
            each.liveliness().declare_token(f"{RUN}/alive/{name}")
            for each in sessions[:3]
            for name in ("process_0", COORDINATOR)
        ]
        with open_client(router.endpoint) as listener:
            deadline = time.monotonic() + 30
            while not (found := alive(listener)) and time.monotonic() < deadline:
                time.sleep(0.05)  # the router has not heard of the token yet
            assert found == [f"{RUN}/alive/process_0"]
            assert alive(listener) == found
        del tokens
    finally:
        for each in sessions:
            each.close()


@pytest.mark.parametrize("name", ["guest", "process_0", COORDINATOR])
def test_nobody_asks_the_router_who_listens(router: Router, name: str) -> None:
    """Not even who leads: asked while somebody declares, a router can lock up for good."""
    credentials = router.credentials(name)
    with open_client(router.endpoint, credentials=credentials) as asks:
        Ear(asks)
        found = list(asks.get("@/*/router/subscriber/**", timeout=1.0))
    assert [reply for reply in found if reply.ok is not None] == []


def test_the_list_names_everyone_once() -> None:
    """With rules of its own for each process, and everything else denied."""
    found = access_list(3, "cert_common_names")
    assert (found["enabled"], found["default_permission"]) == (True, "deny")
    assert [each.get("cert_common_names") for each in found["subjects"]] == [
        None,
        ["coordinator"],
        ["process_0"],
        ["process_1"],
        ["process_2"],
    ]
    ids = [rule["id"] for rule in found["rules"]]
    assert len(set(ids)) == len(ids)
    used = [rule for policy in found["policies"] for rule in policy["rules"]]
    assert sorted(used) == sorted(ids)
