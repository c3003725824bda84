"""Joining a run from elsewhere, over real sessions: versions that differ are refused."""

import threading
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
import zenoh

from cubepath.agents.processes.config import ProcessConfig
from cubepath.agents.processes.fleet import LockstepFleet
from cubepath.agents.processes.joining import Joining, join
from cubepath.agents.processes.membership import (
    PROTOCOL,
    JoinOffer,
    JoinRequest,
    Liveness,
    alive_key,
    offer,
    orders_key,
    read_offer,
)
from cubepath.agents.processes.network import NetworkConfig
from cubepath.agents.processes.remote_processes import LOOK_MAX, QUESTIONS_MAX, RemoteProcesses
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.credentials import COORDINATOR, Credentials
from cubepath.protocol.wire.router import Router
from cubepath.protocol.wire.sessions import open_client
from processes.elsewhere import soon

pytestmark = pytest.mark.slow

RUN = "0123456789ab"


@pytest.fixture(scope="module")
def endpoint() -> Iterator[str]:
    """Return where an open router listens."""
    with Router("tcp/127.0.0.1:0") as router:
        yield router.endpoint


HOSTILE = (
    b'{"modules": [0], "joiner": "\xff\xfe", "protocol": 3}',
    b'{"modules": [0], "joiner": "me", "more": ' + b"[" * 100_000 + b"]" * 100_000 + b"}",
    b'{"modules": [0], "joiner": "' + b"x" * 1000 + b'", "protocol": 3}',
    b'{"modules": [-1], "joiner": "me", "protocol": 3}',
    b'{"modules": [1180591620717411303424], "joiner": "me", "protocol": 3}',
    b'{"modules": [' + b"0," * 70_000 + b'0], "joiner": "me", "protocol": 3}',
)
"""No UTF-8, nested without end, and texts, numbers and lists beyond their bounds."""


def answers(endpoint: str, run: str, who: str, request: bytes | None) -> list[str]:
    """Return the errors that a request to join is answered, without line ends."""
    with open_client(endpoint) as session:
        replies = session.get(orders_key(run, who), payload=request, timeout=5.0)
        return [reply.err.payload.to_string() for reply in replies if reply.err is not None]


def test_a_request_that_is_none_or_of_another_version_is_refused(endpoint: str) -> None:
    """In one line each; the run goes on waiting, and takes the next."""
    begun: list[LockstepFleet] = []
    waits = threading.Event()

    def play() -> None:
        fleet = LockstepFleet(
            scene_from_spec("hex:n=4"),
            "random",
            processes=0,
            network=NetworkConfig(connect=endpoint, wait_for=1),
            say=lambda line: waits.set() if line.startswith("waiting") else None,
        )
        begun.append(fleet)
        with fleet:
            for _ in fleet.rounds(3):
                pass

    thread = threading.Thread(target=play)
    thread.start()
    assert waits.wait(30)
    (fleet,) = begun
    older = msgspec.json.encode(JoinRequest([0], "me", PROTOCOL - 1))
    own = msgspec.json.encode(JoinRequest([0], "me", PROTOCOL))
    expected = "expected the same version of cubepath on both"
    for who, request, line in (
        ("any", older, f"speaks protocol {PROTOCOL - 1} of cubepath, the coordinator {PROTOCOL}"),
        ("any", older, expected),
        ("any", b'{"modules": [0], "joiner": "me"}', "speaks protocol 0 of cubepath"),
        ("any", b"not json", "not a request to join: "),
        *(("any", data, "not a request to join: ") for data in HOSTILE),
        ("any", None, "not a request to join: "),
        ("somebody", own, "somebody: expected process_N, or any"),
        ("process_1x", own, "process_1x: expected process_N, or any"),
    ):
        (found,) = answers(endpoint, fleet.run, who, request)
        assert line in found
        assert "\n" not in found
    orders = join(Joining(endpoint, (0, 1), run=fleet.run))
    assert (orders.process, orders.modules, orders.processes) == (0, [0, 1], [[0, 1], [2, 3]])
    thread.join(30)
    assert not thread.is_alive()


def test_a_coordinator_of_another_version_is_refused(endpoint: str) -> None:
    """By the process that would join it, before it reads the orders, which may be different."""
    strange = msgspec.json.encode(JoinOffer(PROTOCOL + 1, msgspec.Raw(b'{"strange": true}')))
    with pytest.raises(InputError, match=rf"cubepath, the coordinator {PROTOCOL + 1}: "):
        join_offered(endpoint, strange)


@pytest.mark.parametrize("given", [None, "other.py:MINE"])
def test_a_file_that_a_run_names_does_not_run(
    endpoint: str, tmp_path: Path, given: str | None
) -> None:
    """Unless the process that joins names this file, too."""
    file, ran = tmp_path / "mine.py", tmp_path / "ran"
    file.write_text(f"open({str(ran)!r}, 'w')")
    orders = ProcessConfig("", RUN, 0, [0], [[0]], "", f"{file}:MINE", 0, 0.0, 0)
    with pytest.raises(InputError, match=r"mine.py:MINE' is in a file, which does not run"):
        join_offered(endpoint, offer(orders), given)
    assert not ran.exists()


def join_offered(endpoint: str, data: bytes, rule: str | None = None) -> None:
    """Join a run whose coordinator answers with this offer."""
    with open_client(endpoint) as session:
        token = session.liveliness().declare_token(alive_key(RUN, COORDINATOR))

        def reply(query: zenoh.Query) -> None:
            query.reply(str(query.key_expr), data)

        callback = zenoh.handlers.Callback(reply, indirect=False)
        queryable = session.declare_queryable(orders_key(RUN), callback)
        try:
            join(Joining(endpoint, (0,), run=RUN, rule=rule))
        finally:
            queryable.undeclare()
            token.undeclare()


def test_a_flood_of_questions_can_be_interrupted_and_is_bounded(endpoint: str) -> None:
    """Each look takes a number of them, and what is too many is dropped: who asks asks again."""
    joiners = RemoteProcesses(endpoint, "flooded", 4, 1, Credentials(COORDINATOR, "", ""))
    with open_client(endpoint) as session:
        came: list[int] = []

        def answered(_: zenoh.Reply) -> None:
            came.append(1)

        for _ in range(3 * QUESTIONS_MAX):
            session.get(
                orders_key("flooded", "any"),
                zenoh.handlers.Callback(answered, indirect=False),
                payload=b"x",
                timeout=60.0,
            )
        soon(lambda: joiners.dropped > 0)
        joiners.look()
        soon(lambda: len(came) > 0)
        assert len(came) <= LOOK_MAX
    joiners.close()


def test_orders_that_are_none_are_told_of() -> None:
    """CheckError: somebody else has answered."""
    for data in (
        b"",
        b"{}",
        *HOSTILE,
        msgspec.json.encode(JoinOffer(PROTOCOL, msgspec.Raw(b"{}"))),
    ):
        with pytest.raises(CheckError, match="not the orders of a process"):
            read_offer(data)


def test_a_coordinator_that_leaves_is_noticed_at_once(endpoint: str) -> None:
    """Long before the patience is over."""
    session = open_client(endpoint)
    token = session.liveliness().declare_token(alive_key(RUN, COORDINATOR))
    told: list[str] = []
    errors: list[str] = []

    def wait() -> None:
        with pytest.raises(CheckError) as caught:
            join(Joining(endpoint, (0,), run=RUN), told.append)
        errors.append(str(caught.value))

    thread = threading.Thread(target=wait)
    thread.start()
    soon(lambda: bool(told))
    token.undeclare()
    soon(lambda: bool(errors))
    session.close()
    thread.join()
    assert errors == [f"the coordinator of run {RUN} is gone"]


def test_a_token_that_is_never_seen_has_gone(endpoint: str) -> None:
    """A coordinator may leave between being found and being watched; others are not missed."""
    with open_client(endpoint) as session:
        token = session.liveliness().declare_token(alive_key(RUN, "process_0"))
        liveness = Liveness(session, alive_key(RUN), alive_key(RUN, COORDINATOR))
        soon(lambda: bool(liveness.gone()))
        assert liveness.gone() == [alive_key(RUN, COORDINATOR)]
        assert not liveness.is_alone()
        token.undeclare()


@pytest.mark.parametrize(
    ("joining", "line"),
    [
        (Joining("tls/127.0.0.1:1", (0,)), "expected a folder of certificates"),
        (Joining("tcp/127.0.0.1:1", (0,), secure=Path("x")), "expected tls/HOST:PORT with"),
        (Joining("tls/127.0.0.1:1", (0,), secure=Path("x")), "expected also --as process_N"),
        (Joining("tcp/127.0.0.1:1#iface=eth0", (0,)), "expected tcp/HOST:PORT or tls/HOST:PORT"),
    ],
)
def test_what_cannot_be_tried_is_refused_at_once(joining: Joining, line: str) -> None:
    """InputError, before anything is opened."""
    with pytest.raises(InputError, match=line):
        join(joining)
