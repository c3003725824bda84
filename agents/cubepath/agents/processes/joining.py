"""A module process that joins a run from elsewhere.

It finds the run that waits at a router, asks for its configuration until it has one, and then
serves as any module process does. It ends when it is told to, or when the coordinator is gone.
"""

import time
import uuid
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import msgspec
import zenoh
from msgspec.structs import replace

from cubepath.agents.processes.config import ProcessConfig
from cubepath.agents.processes.membership import (
    ANY,
    ASK_S,
    ENDED,
    PROTOCOL,
    JoinRequest,
    Liveness,
    alive_key,
    orders_key,
    read_offer,
)
from cubepath.agents.processes.node import HostNode
from cubepath.agents.processes.pacer import PATIENCE_S
from cubepath.agents.rules.registry import permitted_rule
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.wire.credentials import COORDINATOR, GUEST, Credentials, process_name
from cubepath.protocol.wire.keys import topic_key
from cubepath.protocol.wire.router import check_secure
from cubepath.protocol.wire.sessions import (
    check_descriptors,
    check_endpoint,
    is_reachable,
    open_client,
    subscribe,
)
from cubepath.protocol.wire.shell import Shell

_POLL_S = 0.1
_STEP_S = 0.5
_TAKE_S = 1.5
"""How long an address may take to accept a connection; a run may just be about to listen there."""


@dataclass(frozen=True, slots=True)
class Joining:
    """A process that wants to join: where, and with which modules."""

    connect: str
    modules: tuple[int, ...]
    run: str | None = None
    """The run, where more than one waits."""
    name: str | None = None
    """``process_N``, to have that number."""
    secure: Path | None = None
    """The folder of certificates, one of them of that name."""
    patience_s: float = PATIENCE_S
    rule: str | None = None
    """FILE.py:NAME, if the run may name this file for its rule; others do not run."""

    def check(self) -> None:
        """InputError if it cannot be tried at all."""
        check_endpoint(self.connect, connect=True)
        check_secure(self.connect, self.secure)
        if self.secure is not None and self.name is None:
            raise InputError("secure: expected also --as process_N, the name of its certificate")

    @property
    def credentials(self) -> Credentials:
        """Return by what it shows who it is."""
        if self.secure is None:
            return GUEST
        return Credentials(self.name or "", "", str(self.secure))


def join(joining: Joining, say: Callable[[str], None] = lambda _: None) -> ProcessConfig:
    """Join a run and serve until it ends; return the orders that it gave.

    InputError if the run refuses the process. CheckError if nothing answers at the address, soon;
    if there is no run, or if it ends without a word. `say` gets a line on what is going on.
    """
    joining.check()
    check_descriptors()
    deadline = time.monotonic() + joining.patience_s
    with _connected(joining) as session:
        run = _run_that_waits(session, joining, deadline)
        coordinator = alive_key(run, COORDINATOR)
        liveness = Liveness(session, coordinator, coordinator)
        say(f"waiting for run {run} to begin")
        found = _ordered(session, joining, run, liveness)
        given = () if joining.rule is None else (joining.rule,)
        recorded = found.recorded
        if recorded is not None:
            rules = {who: permitted_rule(name, given) for who, name in recorded.rules.items()}
            recorded = replace(recorded, rules=rules)
        orders = replace(
            found,
            recorded=recorded,
            rule=permitted_rule(found.rule, given),
            endpoint=joining.connect,
            credentials=joining.credentials,
        )
        say(f"joined run {run} as {process_name(orders.process)}")
        # Before the scene is read: what goes wrong with it is then noticed immediately.
        with session.liveliness().declare_token(alive_key(run, process_name(orders.process))):
            _serve(session, orders, liveness, joining.patience_s)
    return orders


def _connected(joining: Joining) -> zenoh.Session:
    """Open a session; patience is for a router that is there, and may stand still."""
    if not is_reachable(joining.connect, min(_TAKE_S, joining.patience_s)):
        raise CheckError(f"no zenoh router at {joining.connect}: no answer")
    return open_client(joining.connect, joining.patience_s, credentials=joining.credentials)


def _run_that_waits(session: zenoh.Session, joining: Joining, deadline: float) -> str:
    """Return the run that is to be joined, once it is there."""
    while True:
        key = alive_key(joining.run or "*", COORDINATOR)
        replies = session.liveliness().get(key, timeout=ASK_S)
        runs = sorted({str(each.ok.key_expr).split("/")[1] for each in replies if each.ok})
        if len(runs) == 1:
            return runs[0]
        if runs:
            raise InputError(
                f"{len(runs)} runs are at {joining.connect}: expected --run, one of"
                f" {', '.join(runs)}"
            )
        if time.monotonic() >= deadline:
            which = "no run waits" if joining.run is None else f"run {joining.run} does not wait"
            raise CheckError(f"{which} at {joining.connect}")
        time.sleep(_POLL_S)


def _ordered(
    session: zenoh.Session, joining: Joining, run: str, liveness: Liveness
) -> ProcessConfig:
    """Ask until the run answers; it does so when all that it waits for are there."""
    key = orders_key(run, joining.name or ANY)
    data = msgspec.json.encode(JoinRequest(list(joining.modules), uuid.uuid4().hex, PROTOCOL))
    while True:
        begun = time.monotonic()
        for reply in session.get(key, payload=data, timeout=ASK_S):
            if reply.ok is not None:
                return read_offer(reply.ok.payload.to_bytes())
            if reply.err is not None and not _is_timeout(reply.err):
                line = reply.err.payload.to_string()
                raise CheckError(line) if line == ENDED else InputError(line)
        _check_there(liveness, run)
        time.sleep(max(0.0, min(_POLL_S, begun + ASK_S - time.monotonic())))


def _is_timeout(error: zenoh.ReplyError) -> bool:
    return error.payload.to_string() == "Timeout"


def _check_there(liveness: Liveness, run: str) -> None:
    if liveness.is_alone():
        raise CheckError(f"the router of run {run} is gone")
    if liveness.gone():
        raise CheckError(f"the coordinator of run {run} is gone")


def _serve(
    session: zenoh.Session, orders: ProcessConfig, liveness: Liveness, patience_s: float
) -> None:
    """Serve until the run stops, its coordinator is gone, or nothing arrives for this long."""
    begun = time.monotonic()
    heard: list[float] = []

    def note(_: zenoh.Sample) -> None:
        heard[:] = [time.monotonic()]

    # The coordinator says `go`, to whom it may, as long as it waits for anyone.
    key, node = topic_key(orders.run, "go"), HostNode(orders)
    with (
        subscribe(session, key, note),
        Shell(node, orders.endpoint, credentials=orders.credentials) as shell,
    ):
        shell.start()
        looked = time.monotonic()
        while not shell.ended:
            shell.step(_STEP_S)
            now = time.monotonic()
            if now - looked < _STEP_S:
                continue
            looked = now
            _check_there(liveness, orders.run)
            # Before the first round others are still being started.
            due = heard[0] + patience_s if heard else begun + max(patience_s, PATIENCE_S)
            if now > due:
                raise CheckError(f"nothing was heard of run {orders.run} for {patience_s:g} s")
