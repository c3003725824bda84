"""Linked routers: they serve as one, a session outlives its router, and each lets in its own."""

from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.wire.access import guarded_by_certificates
from cubepath.protocol.wire.authority import make_certificates
from cubepath.protocol.wire.credentials import COORDINATOR, Credentials
from cubepath.protocol.wire.router import Router
from cubepath.protocol.wire.sessions import (
    check_endpoints,
    open_client,
    open_router,
    put,
    subscribe,
)
from processes.elsewhere import soon

pytestmark = pytest.mark.slow

LOOPBACK = "tcp/127.0.0.1:0"
RUN = "cubepath/0123456789ab"


@pytest.fixture
def linked() -> Iterator[tuple[Router, Router]]:
    """Return two open routers, the second linked with the first."""
    with Router(LOOPBACK) as one, Router(LOOPBACK, links=[one.endpoint]) as other:
        yield one, other


def test_a_session_goes_on_at_another_router_when_its_own_dies(
    linked: tuple[Router, Router],
) -> None:
    """With what it listens to, and its token; the router that died is linked again."""
    one, other = linked
    heard: list[str] = []
    with (
        open_client(f"{one.endpoint},{other.endpoint}") as session,
        open_client(other.endpoint) as listener,
        session.liveliness().declare_token(f"{RUN}/alive/process_0"),
    ):
        subscribe(session, f"{RUN}/go/**", lambda sample: heard.append(str(sample.key_expr)))

        def passes() -> bool:
            put(listener, f"{RUN}/go/coordinator", b"")
            tokens = listener.liveliness().get(f"{RUN}/alive/*", timeout=1.0)
            return bool(heard) and any(reply.ok is not None for reply in tokens)

        def at() -> list[str]:
            return [str(each) for each in session.info.routers_zid()]

        soon(passes)
        before = at()
        one._child.kill()
        soon(lambda: at() not in (before, []))
        heard.clear()
        soon(passes)
        assert one.look_after()
        heard.clear()
        with open_client(one.endpoint, None) as back:

            def hears() -> bool:
                put(back, f"{RUN}/go/coordinator", b"")
                return bool(heard)

            soon(hears)


def test_each_router_lets_its_clients_speak_on_their_own_keys_alone(tmp_path: Path) -> None:
    """Whichever router they come to, and whoever listens at which."""
    folder = tmp_path / "fleet"
    make_certificates(folder, processes=2, keepers=1)
    topics = [
        f"{kind}/{name}"
        for kind, name in (
            *(("ready", "process_0"), ("ready", "process_1"), ("go", "coordinator")),
            *(("commit", "keeper_0"), ("summary", "coordinator")),
        )
    ]
    own = {
        "process_0": {"ready/process_0"},
        "process_1": {"ready/process_1"},
        "keeper_0": {"commit/keeper_0"},
        "guest": set[str](),
        COORDINATOR: {*topics},
    }
    where = "tls/127.0.0.1:0"
    with (
        Router(where, secure=folder) as one,
        Router(where, secure=folder, links=[one.endpoint]) as other,
    ):
        for near, far in ((one, other), (other, one)):
            for name, allowed in own.items():
                with (
                    open_client(far.endpoint, credentials=_named(folder, COORDINATOR)) as listener,
                    open_client(near.endpoint, credentials=_named(folder, COORDINATOR)) as last,
                ):
                    speaker = near.endpoint, _named(folder, name)
                    assert _heard(listener, last, speaker, topics) == allowed


@pytest.mark.parametrize("listed", [True, False])
def test_what_a_router_that_was_taken_over_makes_others_hear(tmp_path: Path, listed: bool) -> None:
    """Messages of those that it is listed for; of anyone, if it has the certificate of the rest.

    Its own clients hear whatever it says, and others hear one another all the same.
    """
    folder = tmp_path / "fleet"
    hosts = ["a.lan=process_0,keeper_0", "b.lan=process_1"]
    make_certificates(folder, processes=2, keepers=1, hosts=hosts)
    topics = ["ready/process_0", "ready/process_1", "commit/keeper_0", "go/coordinator"]
    where = "tls/127.0.0.1:0"
    coordinator, liar = _named(folder, COORDINATOR), _named(folder, "process_1")
    guard = guarded_by_certificates(folder / "a.lan" if listed else folder)
    lies = {**guard, "access_control": {"enabled": False}}
    with Router(where, secure=folder) as hub:
        taken, there = open_router(where, lies, 1 << 20, [hub.endpoint])
        with (
            taken,
            Router(where, secure=folder / "b.lan", links=[hub.endpoint, there]) as other,
            open_client(hub.endpoint, credentials=coordinator) as leads,
        ):
            allowed = {"ready/process_0", "commit/keeper_0"} if listed else {*topics}
            for router in (hub, other):
                with open_client(router.endpoint, credentials=coordinator) as listener:
                    assert _heard(listener, leads, (there, liar), topics) == allowed
            with open_client(there, credentials=liar) as listener:
                assert _heard(listener, leads, (there, liar), topics) == {*topics}
            with open_client(hub.endpoint, credentials=coordinator) as listener:
                speaker = other.endpoint, liar
                assert _heard(listener, leads, speaker, topics) == {"ready/process_1"}


def _named(folder: Path, name: str) -> Credentials:
    return Credentials(name, "", str(folder))


def _heard(
    listener: zenoh.Session,
    last: zenoh.Session,
    speaker: tuple[str, Credentials],
    topics: list[str],
) -> set[str]:
    """Return the topics on which a listener at one router hears a speaker at another."""
    found: set[str] = set()
    subscribe(listener, f"{RUN}/**", lambda sample: found.add(str(sample.key_expr)[len(RUN) + 1 :]))

    def comes(session: zenoh.Session, topic: str) -> bool:
        put(session, f"{RUN}/{topic}", b"")
        return topic in found

    soon(lambda: comes(last, "edges/coordinator"))
    with open_client(speaker[0], credentials=speaker[1]) as session:
        for topic in topics:
            put(session, f"{RUN}/{topic}", b"")
        # What it put is at its router when this answers.
        list(session.get(f"{RUN}/state", timeout=10.0))
    soon(lambda: comes(last, "refused/coordinator"))
    return found - {"edges/coordinator", "refused/coordinator"}


def test_each_of_several_endpoints_is_checked() -> None:
    """The first that is wrong is named."""
    check_endpoints("tcp/a:1,tls/b:2#bind=c:0")
    with pytest.raises(InputError, match=r"^endpoint udp/b:2: expected tcp/HOST:PORT or"):
        check_endpoints("tcp/a:1,udp/b:2")
