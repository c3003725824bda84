"""Joining a run from elsewhere, over real sessions: versions that differ are refused."""

import re
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
import zenoh

from cubepath.agents.free.joining import Joining, _begin, join
from cubepath.agents.keepers.config import KeeperConfig
from cubepath.agents.processes import membership
from cubepath.agents.processes.config import ProcessConfig
from cubepath.agents.processes.fleet import LockstepFleet
from cubepath.agents.processes.membership import (
    PROTOCOL,
    SILENT_S,
    JoinOffer,
    JoinRequest,
    Liveness,
    Membership,
    alive_key,
    offer,
    orders_key,
    read_offer,
    read_orders,
)
from cubepath.agents.processes.network import NetworkConfig
from cubepath.agents.processes.remote_processes import LOOK_MAX, QUESTIONS_MAX, RemoteProcesses
from cubepath.protocol.core.errors import CheckError, CubepathError, InputError
from cubepath.protocol.core.output_files import locked_file
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
        ("somebody", own, "somebody: expected process_N, keeper_K, or any"),
        ("process_1x", own, "process_1x: expected process_N, keeper_K, or any"),
    ):
        (found,) = answers(endpoint, fleet.run, who, request)
        assert line in found
        assert "\n" not in found
    orders = join(Joining(endpoint, (0, 1), run=fleet.run))
    assert isinstance(orders, ProcessConfig)
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


def join_offered(
    endpoint: str, data: bytes, rule: str | None = None, name: str | None = None
) -> None:
    """Join a run whose coordinator answers with this offer."""
    with open_client(endpoint) as session:
        token = session.liveliness().declare_token(alive_key(RUN, COORDINATOR))

        def reply(query: zenoh.Query) -> None:
            query.reply(str(query.key_expr), data)

        callback = zenoh.handlers.Callback(reply, indirect=False)
        queryable = session.declare_queryable(orders_key(RUN), callback)
        try:
            modules = () if name else (0,)
            join(Joining(endpoint, modules, run=RUN, name=name, rule=rule))
        finally:
            queryable.undeclare()
            token.undeclare()


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"log_run": "../elsewhere"}, "the log is of run '../elsewhere'"),
        ({"incarnation": 2}, "keeper_0.log: not there, expected what keeper_0 has"),
        ({"log_run": "busy"}, "busy.keepers/keeper_0.log: another keeper writes there"),
    ],
)
def test_a_keeper_has_a_log_of_its_own(
    endpoint: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    change: dict[str, Any],
    line: str,
) -> None:
    """Below the folder where it joins, whole, and of no other keeper; or it does not begin."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "logs" / "busy.keepers").mkdir(parents=True)
    given: dict[str, Any] = {"log_run": RUN, **change}
    orders = KeeperConfig("", RUN, 0, 1, [[0]], "", "", **given)
    with (
        locked_file(tmp_path / "logs" / "busy.keepers" / "keeper_0.lock"),
        pytest.raises(CubepathError, match=re.escape(line)),
    ):
        join_offered(endpoint, offer(orders, "free"), name="keeper_0")
    assert not list(tmp_path.glob("**/*.log"))


def test_a_log_that_was_handed_over_goes_where_its_keeper_may_not_begin(tmp_path: Path) -> None:
    """It would be older than the log of the keeper there, and may look like a whole one."""
    log = tmp_path / "keeper_0.log"
    log.write_bytes(b"handed over")
    orders = KeeperConfig("", RUN, 0, 1, [[0]], "", str(log), RUN, logged=b"handed over")
    _begin(lambda: b"", orders)
    assert log.exists()

    def refused() -> None:
        raise InputError("another process has taken this place")

    with pytest.raises(InputError):
        _begin(refused, orders)
    assert not log.exists()


def test_a_flood_of_questions_can_be_interrupted_and_is_bounded(endpoint: str) -> None:
    """Each look takes a number of them, and what is too many is dropped: who asks asks again."""
    coordinator = Credentials(COORDINATOR, "", "")
    joiners = RemoteProcesses(endpoint, "flooded", Membership(4, 1), coordinator)
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
            read_orders(read_offer(data).orders, ProcessConfig)


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


def test_a_token_that_goes_after_silence_is_of_one_who_is_cut_off(endpoint: str) -> None:
    """One that goes while its owner is heard is of one who has died."""
    with open_client(endpoint) as session:
        token = session.liveliness().declare_token(alive_key(RUN, "process_0"))
        liveness = Liveness(session, alive_key(RUN))
        token.undeclare()
        soon(lambda: bool(liveness.gone(0.0)))
        now = time.monotonic()
        assert liveness.gone(0.0, heard=now) == [alive_key(RUN, "process_0")]
        assert liveness.gone(0.0, heard=now - 2 * SILENT_S) == []


def test_a_token_that_is_never_seen_has_gone(endpoint: str) -> None:
    """A coordinator may leave between being found and being watched; others are not missed."""
    with open_client(endpoint) as session:
        token = session.liveliness().declare_token(alive_key(RUN, "process_0"))
        liveness = Liveness(session, alive_key(RUN), alive_key(RUN, COORDINATOR))
        soon(lambda: bool(liveness.gone()))
        assert liveness.gone() == [alive_key(RUN, COORDINATOR)]
        assert not liveness.is_alone()
        token.undeclare()


def test_a_token_that_is_expected_and_does_not_come_has_gone(
    endpoint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A process may end between its offer and its first sign of life; one that is there is not."""
    monkeypatch.setattr(membership, "SETTLE_S", membership.GONE_S + 0.2)
    with open_client(endpoint) as session:
        late, there = (alive_key(RUN, name) for name in ("process_0", "process_1"))
        liveness = Liveness(session, alive_key(RUN))
        token = session.liveliness().declare_token(there)
        soon(lambda: liveness.is_there(there))
        liveness.expect(late)
        liveness.expect(there)
        assert liveness.gone(0.0) == []
        soon(lambda: liveness.gone() == [late])
        token.undeclare()


@pytest.mark.parametrize(
    ("joining", "line"),
    [
        (Joining("tls/127.0.0.1:1", (0,)), "expected a folder of certificates"),
        (Joining("tcp/127.0.0.1:1", (0,), secure=Path("x")), "expected tls/HOST:PORT with"),
        (Joining("tls/127.0.0.1:1", (0,), secure=Path("x")), "expected also --as, the name"),
        (Joining("tcp/127.0.0.1:1"), "expected --modules, or the name of a place"),
        (Joining("tcp/127.0.0.1:1", (0,), name="keeper_0"), "--as keeper_K without --modules"),
        (Joining("tcp/127.0.0.1:1#iface=eth0", (0,)), "expected tcp/HOST:PORT or tls/HOST:PORT"),
    ],
)
def test_what_cannot_be_tried_is_refused_at_once(joining: Joining, line: str) -> None:
    """InputError, before anything is opened."""
    with pytest.raises(InputError, match=line):
        join(joining)
