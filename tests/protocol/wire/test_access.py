"""Who may do what on which keys of a private router: every key that is known, real sessions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from queue import SimpleQueue
from typing import TypeAlias, cast

import pytest
import zenoh

from cubepath.agents.processes.membership import ANY, alive_key, orders_key
from cubepath.coordinator.playback.machine import player_key, position_key
from cubepath.coordinator.runs.asking import about_key, path_key, state_key
from cubepath.protocol.wire.access import access_list
from cubepath.protocol.wire.credentials import COORDINATOR, keeper_name, process_name
from cubepath.protocol.wire.free_messages import FREE_KINDS, FreeMessage, free_key
from cubepath.protocol.wire.keys import ROOT, belongs, everything, key_of, topic_key
from cubepath.protocol.wire.messages import KINDS, Go, Message, Reset
from cubepath.protocol.wire.router import Router
from cubepath.protocol.wire.sessions import open_client, put, subscribe, wait_for_ear
from filled import filled

RIGHTS = """
key                coordinator  process_1  process_0  keeper_1  keeper_0  guest
presence           pdqat        -          -          -         -         -
note               pdqat        -          -          -         -         -
claim              pdqat        -          -          -         -         -
verdict            pdqat        -          -          -         -         -
report             pdqat        -          -          -         -         -
observation        pdqat        -          -          -         -         -
action             pdqat        -          -          -         -         -
bundle             pdqat        p          -          -         -         -
reports            pdqat        p          -          -         -         -
observations       pdqat        p          -          -         -         -
actions            pdqat        -          -          -         -         -
go                 pdqat        -          -          -         -         -
go for one         pdqat        -          -          -         -         -
reset              pdqat        -          -          -         -         -
reset for one      pdqat        -          -          -         -         -
ready              pdqat        p          -          -         -         -
retransmit         pdqat        p          -          -         -         -
waiting            pdqat        p          -          -         -         -
refused            pdqat        -          -          -         -         -
edges              pdqat        -          -          -         -         -
cube               pdqat        -          -          -         -         -
certificate        pdqat        -          -          -         -         -
summary            pdqat        -          -          -         -         -
requests           pdqat        p          -          -         -         -
forwards           pdqat        -          -          p         -         -
replies            pdqat        -          -          p         -         -
tile               pdqat        -          -          p         -         -
commit             pdqat        -          -          p         -         -
turns              pdqat        p          -          -         -         -
halted             pdqat        p          -          -         -         -
fetch              pdqat        -          -          -         -         -
retransmit_range   pdqat        -          -          -         -         -
commits            pdqat        -          -          p         -         -
state              pdqat        q          q          q         q         q
about              pdqat        q          q          q         q         q
path               pdqat        q          q          q         q         q
player status      pdqat        q          q          q         q         q
player position    pdqat        q          q          q         q         q
recorder           pdqat        qa         qa         qa        qa        qa
orders             pdqat        q          -          -         -         -
orders for any     pdqat        -          -          -         -         -
orders of keeper   pdqat        -          -          q         -         -
alive              pdqat        t          -          -         -         -
alive keeper       pdqat        -          -          t         -         -
alive coordinator  pdqat        -          -          -         -         -
elsewhere          -            -          -          -         -         -
"""
"""Who may put (p), delete (d), query (q), answer queries (a) and declare a liveliness token (t).

A row is a kind of message, on the key that the sender of number 1 puts it on, or another key.
"""
NAMES = RIGHTS.split("\n")[1].split()[1:]
ROWS = {
    line[:19].rstrip(): dict(zip(NAMES, line[19:].split(), strict=True))
    for line in RIGHTS.split("\n")[2:-1]
}
RUN = "0123456789ab"
HEARD_S = 10.0
_HUB = "hub"


def key_of_kind(kind: str) -> str:
    """Return the key that a message of a kind is put on, by process 1 or keeper 1."""
    message = filled({**KINDS, **FREE_KINDS}[kind], process=1, keeper=1)
    if kind in KINDS:
        return key_of(RUN, cast("Message", message))
    return free_key(RUN, cast("FreeMessage", message))


KEYS = {
    **{kind: key_of_kind(kind) for kind in (*KINDS, *FREE_KINDS)},
    "go for one": topic_key(RUN, "go", process_name(1)),
    "reset for one": topic_key(RUN, "reset", process_name(1)),
    "state": state_key(RUN),
    "about": about_key(RUN),
    "path": path_key(RUN),
    "player status": f"{player_key(RUN)}/status",
    "player position": position_key(RUN),
    "recorder": topic_key(RUN, "recorder", "some/snapshot"),
    "orders": orders_key(RUN, process_name(1)),
    "orders for any": orders_key(RUN, ANY),
    "alive": alive_key(RUN, process_name(1)),
    "alive keeper": alive_key(RUN, keeper_name(1)),
    "orders of keeper": orders_key(RUN, keeper_name(1)),
    "alive coordinator": alive_key(RUN, COORDINATOR),
    "elsewhere": "elsewhere/go/coordinator",
}
"""The keys that are tried."""
assert belongs(RUN, KEYS["go for one"], Go(1, "sense"))
assert belongs(RUN, KEYS["reset for one"], Reset(1, 1))
Found: TypeAlias = set[tuple[str, str, str]]
"""Key, name and a letter: what was not in vain."""


def _callback(called: Callable[[zenoh.Query], None]) -> zenoh.handlers.Callback[zenoh.Query]:
    return zenoh.handlers.Callback(called, indirect=False)


def _answers(session: zenoh.Session, key: str) -> list[str]:
    """Return what all others answer."""
    replies = session.get(
        key,
        target=zenoh.QueryTarget.ALL,
        consolidation=zenoh.ConsolidationMode.NONE,
        allowed_destination=zenoh.Locality.REMOTE,
        timeout=HEARD_S,
    )
    return [each.ok.payload.to_string() for each in replies if each.ok is not None]


class Hub:
    """A session of the coordinator that hears what the sessions of all names do at a router."""

    def __init__(self, router: Router, stack: ExitStack) -> None:
        """Open the sessions."""

        def opened(name: str) -> zenoh.Session:
            credentials = router.credentials(name)
            return stack.enter_context(open_client(router.endpoint, credentials=credentials))

        self.found: Found = set()
        self.hub = opened(COORDINATOR)
        self.sessions = {name: opened(name) for name in NAMES}
        self._subscriber = subscribe(self.hub, "**", self._heard)
        self._queryable = self.hub.declare_queryable(f"{ROOT}/**", _callback(self._asked))
        for name, session in self.sessions.items():
            wait_for_ear(self.hub, session, topic_key(RUN, "probe", name))

    def _heard(self, sample: zenoh.Sample) -> None:
        letter = "p" if sample.kind == zenoh.SampleKind.PUT else "d"
        if sample.attachment is not None:
            self.found.add((str(sample.key_expr), sample.attachment.to_string(), letter))

    def _asked(self, query: zenoh.Query) -> None:
        if query.attachment is not None:
            self.found.add((str(query.key_expr), query.attachment.to_string(), "q"))
        else:
            query.reply(state_key(RUN), _HUB)

    def settle(self, name: str) -> None:
        """Wait until the hub knows of all that a session did before: links keep the order."""
        answers = _answers(self.sessions[name], state_key(RUN))
        assert _HUB in answers, f"{name} may not even ask for the state of a run"

    def speak(self) -> None:
        """Put, delete and query on every key, in every name."""
        for name, session in self.sessions.items():
            for key in KEYS.values():
                session.put(
                    key, b"", congestion_control=zenoh.CongestionControl.BLOCK, attachment=name
                )
                session.delete(
                    key, congestion_control=zenoh.CongestionControl.BLOCK, attachment=name
                )
                session.get(key, lambda _: None, attachment=name, timeout=HEARD_S)
            self.settle(name)

    def answer(self) -> None:
        """Ask on every key, and take note of the names that answer."""

        def answers(name: str, key: str) -> Callable[[zenoh.Query], None]:
            return lambda query: query.reply(key, name)

        declared = [
            session.declare_queryable(key, _callback(answers(name, key)))
            for name, session in self.sessions.items()
            for key in KEYS.values()
        ]
        for name in NAMES:
            self.settle(name)
        for key in KEYS.values():
            self.found.update((key, name, "a") for name in _answers(self.hub, key))
        for each in declared:
            each.undeclare()

    def live(self) -> None:
        """Declare a token on every key, in one name after the other."""
        for name, session in self.sessions.items():
            tokens = [session.liveliness().declare_token(key) for key in KEYS.values()]
            self.settle(name)
            replies = self.hub.liveliness().get("**", timeout=HEARD_S)
            keys = (str(each.ok.key_expr) for each in replies if each.ok is not None)
            self.found.update((key, name, "t") for key in keys)
            for token in tokens:
                token.undeclare()
            self.settle(name)

    def listen(self) -> dict[str, set[str]]:
        """Put on every key as the coordinator, and return what each name hears."""
        queues = {name: SimpleQueue[str]() for name in NAMES}

        def take(queue: SimpleQueue[str]) -> Callable[[zenoh.Sample], None]:
            return lambda sample: queue.put(str(sample.key_expr))

        ears = [subscribe(self.sessions[name], "**", take(queue)) for name, queue in queues.items()]
        for name in NAMES:
            self.settle(name)
        for key in KEYS.values():
            put(self.hub, key, b"")
        allowed = len(KEYS) - 1
        heard = {
            name: {queue.get(timeout=HEARD_S) for _ in range(allowed)}
            for name, queue in queues.items()
        }
        del ears
        return heard


@pytest.fixture(scope="module")
def router() -> Iterator[Router]:
    """Return a router that knows two processes and two keepers."""
    with Router(processes=2, keepers=2) as found:
        yield found


@pytest.fixture(scope="module")
def found(router: Router) -> Found:
    """Return what is not in vain, of all that is tried in all names on all keys."""
    with ExitStack() as stack:
        hub = Hub(router, stack)
        hub.speak()
        hub.answer()
        hub.live()
        return hub.found


@pytest.mark.slow
@pytest.mark.parametrize("row", KEYS)
def test_each_name_may_do_what_the_table_says(found: Found, row: str) -> None:
    """On every key, and nothing else; a kind of message without a row has no rights."""
    rights = {
        name: "".join(each for each in "pdqat" if (KEYS[row], name, each) in found) or "-"
        for name in NAMES
    }
    assert rights == ROWS[row]


@pytest.mark.slow
def test_everyone_hears_everything(router: Router) -> None:
    """Whoever is let in may listen to every key of every run."""
    with ExitStack() as stack:
        heard = Hub(router, stack).listen()
    assert heard == dict.fromkeys(NAMES, {*KEYS.values()} - {KEYS["elsewhere"]})


def test_the_table_has_a_row_for_each_key() -> None:
    """And no row for a key that is gone."""
    assert ROWS.keys() == KEYS.keys()


def test_each_right_is_one_to_a_key_that_is_used() -> None:
    """A right to a key that no message and no query is on any more is one to nothing."""
    listed = access_list(2, "usernames", keepers=2)
    keys = [zenoh.KeyExpr(key) for key in KEYS.values()]
    unused = [
        expression
        for rule in listed["rules"]
        for expression in rule["key_exprs"]
        if not expression.endswith("_0")
        and not any(zenoh.KeyExpr(expression).includes(key) for key in keys)
    ]
    assert unused == []


@pytest.mark.slow
@pytest.mark.parametrize("name", ["guest", "process_0", COORDINATOR])
def test_nobody_asks_the_router_who_listens(router: Router, name: str) -> None:
    """Not even who leads: asked while somebody declares, a router can lock up for good."""
    with open_client(router.endpoint, credentials=router.credentials(name)) as asks:
        asks.declare_subscriber(everything(RUN))
        found = list(asks.get("@/*/router/subscriber/**", timeout=1.0))
    assert [reply for reply in found if reply.ok is not None] == []


def test_the_list_names_everyone_once() -> None:
    """With rules of its own for each process, and everything else denied."""
    found = access_list(3, "cert_common_names")
    assert (found["enabled"], found["default_permission"]) == (True, "deny")
    assert [each.get("cert_common_names") for each in found["subjects"]] == [
        None,
        ["coordinator"],
        ["router"],
        ["process_0"],
        ["process_1"],
        ["process_2"],
    ]
    ids = [rule["id"] for rule in found["rules"]]
    assert len(set(ids)) == len(ids)
    used = [rule for policy in found["policies"] for rule in policy["rules"]]
    assert sorted(used) == sorted(ids)
