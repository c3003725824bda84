"""A process that joins a run of either clock from elsewhere: with modules, or as a keeper.

It finds the run that waits at a router, asks for its configuration until it has one, and then
serves as any process of the run does. It ends when it is told to, or when the coordinator is gone.
"""

import contextlib
import math
import time
import uuid
from collections.abc import Callable, Generator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeAlias

import msgspec
import zenoh
from msgspec.structs import replace

from cubepath.agents.free.config import FreeProcessConfig
from cubepath.agents.free.host_node import FreeHostNode
from cubepath.agents.keepers.config import KeeperConfig
from cubepath.agents.keepers.process import keeper_node
from cubepath.agents.processes.config import ProcessConfig
from cubepath.agents.processes.membership import (
    ANY,
    ASK_S,
    ENDED,
    GONE_S,
    LOG_BYTES_MAX,
    PROTOCOL,
    SETTLE_S,
    JoinOffer,
    JoinRequest,
    Liveness,
    alive_key,
    orders_key,
    read_offer,
    read_orders,
)
from cubepath.agents.processes.node import HostNode
from cubepath.agents.processes.pacer import PATIENCE_S
from cubepath.agents.rules.registry import permitted_rule
from cubepath.protocol.core.errors import CheckError, CubepathError, InputError
from cubepath.protocol.core.output_files import locked_file, unwritable, written_whole
from cubepath.protocol.wire.credentials import (
    COORDINATOR,
    GUEST,
    Credentials,
    keeper_name,
    process_name,
)
from cubepath.protocol.wire.keys import topic_key
from cubepath.protocol.wire.nodes import Node
from cubepath.protocol.wire.router import check_secure
from cubepath.protocol.wire.sessions import (
    check_descriptors,
    check_endpoints,
    is_reachable,
    open_client,
    subscribe,
)
from cubepath.protocol.wire.shell import Shell

Orders: TypeAlias = ProcessConfig | FreeProcessConfig | KeeperConfig
_POLL_S = 0.1
_STEP_S = 0.5
_TAKE_S = 1.5
"""How long an address may take to accept a connection; a run may just be about to listen there."""


@dataclass(frozen=True, slots=True)
class Joining:
    """A process that wants to join: where, and with which modules, or in whose place."""

    connect: str
    modules: tuple[int, ...] = ()
    """None: those of the process whose place it takes."""
    run: str | None = None
    """The run, where more than one waits."""
    name: str | None = None
    """``process_N``, to have that number, or ``keeper_K``."""
    secure: Path | None = None
    """The folder of certificates, one of them of that name."""
    patience_s: float = PATIENCE_S
    rule: str | None = None
    """FILE.py:NAME, if the run may name this file for its rule; others do not run."""

    @property
    def is_keeper(self) -> bool:
        """Whether it wants to keep sites."""
        return self.name is not None and self.name.startswith("keeper_")

    def check(self) -> None:
        """InputError if it cannot be tried at all."""
        if self.is_keeper and self.modules:
            raise InputError("modules: a keeper has none, expected --as keeper_K without --modules")
        if not self.modules and self.name is None:
            raise InputError("modules: expected --modules, or the name of a place by --as")
        check_endpoints(self.connect)
        check_secure(self.connect, self.secure)
        if self.secure is not None and self.name is None:
            raise InputError("secure: expected also --as, the name of its certificate")

    @property
    def credentials(self) -> Credentials:
        """Return by what it shows who it is."""
        if self.secure is None:
            return GUEST
        return Credentials(self.name or "", "", str(self.secure))


def join(joining: Joining, say: Callable[[str], None] = lambda _: None) -> Orders:
    """Join a run and serve until it ends; return the orders that it gave.

    InputError if the run refuses the process. CheckError if nothing answers at the address, soon;
    if there is no run, if it ends without a word, or if another process takes the place of this
    one. `say` gets a line on what is going on.
    """
    joining.check()
    check_descriptors()
    deadline = time.monotonic() + joining.patience_s
    with _connected(joining) as session:
        run = _run_that_waits(session, joining, deadline)
        coordinator = alive_key(run, COORDINATOR)
        liveness = Liveness(session, coordinator, coordinator)
        say(f"waiting for run {run} to begin")
        request = JoinRequest(list(joining.modules), uuid.uuid4().hex, PROTOCOL)
        key = orders_key(run, joining.name or ANY)
        orders = _own(read_offer(_answered(session, key, request, run, liveness)), joining)
        name = _name(orders)
        say(f"joined run {run} as {name}{_whereabouts(orders)}")
        token = session.liveliness().declare_token(alive_key(run, name))
        try:
            # Before the scene is read: what goes wrong with it is then noticed immediately.
            with token, _node(orders) as node:
                if isinstance(orders, KeeperConfig) and orders.logged:
                    begin = replace(request, wants="begin")
                    _begin(partial(_answered, session, key, begin, run, liveness), orders)
                _serve(session, orders, node, liveness, joining.patience_s)
                if isinstance(node, FreeHostNode) and node.superseded:
                    raise CheckError(f"another process has taken the place of {name}")
        except KeyboardInterrupt:
            if not isinstance(orders, ProcessConfig):
                say(f"{name} {_give_back(session, key, request, orders)}")
            raise
    return orders


def _begin(ask: Callable[[], object], orders: KeeperConfig) -> None:
    """Begin with a log that was handed over, if the run agrees; otherwise the log goes."""
    try:
        ask()
    except CubepathError:
        Path(orders.log).unlink()
        raise


def _give_back(
    session: zenoh.Session, key: str, request: JoinRequest, orders: FreeProcessConfig | KeeperConfig
) -> str:
    """Let the run continue for a process that leaves, and return whether it does.

    A keeper's log goes back with it, and is then no longer here.
    """
    log = Path(orders.log) if isinstance(orders, KeeperConfig) else None
    data = log.read_bytes() if log is not None and log.exists() else b""
    if len(data) > LOG_BYTES_MAX:
        return f"leaves: its log has {len(data)} bytes, more than can be handed back"
    leaves = msgspec.json.encode(replace(request, wants="leave", log=data))
    for reply in session.get(key, payload=leaves, timeout=ASK_S):
        if reply.ok is not None:
            if log is not None:
                log.unlink(missing_ok=True)
            return "was handed back"
        if reply.err is not None and not _is_timeout(reply.err):
            return f"leaves: {reply.err.payload.to_string()}"
    return "leaves: the run does not answer"


def _own(found: JoinOffer, joining: Joining) -> Orders:
    """Return the orders in an offer, with what only this host knows."""
    given = () if joining.rule is None else (joining.rule,)
    here = {"endpoint": joining.connect, "credentials": joining.credentials}
    if joining.is_keeper:
        keeper = read_orders(found.orders, KeeperConfig)
        # The run is that which began the logs: one that resumes it finds them again.
        log = Path("logs") / f"{_plain(keeper.log_run)}.keepers" / f"{joining.name}.log"
        if keeper.logged:  # the run keeps it until this process asks to begin
            with _locked(log), written_whole(log) as file:
                file.write(keeper.logged)
        return replace(keeper, log=str(log), **here)
    if found.clock == "free":
        free = read_orders(found.orders, FreeProcessConfig)
        return replace(free, rule=permitted_rule(free.rule, given), **here)
    orders = read_orders(found.orders, ProcessConfig)
    recorded = orders.recorded
    if recorded is not None:
        rules = {who: permitted_rule(name, given) for who, name in recorded.rules.items()}
        recorded = replace(recorded, rules=rules)
    return replace(orders, recorded=recorded, rule=permitted_rule(orders.rule, given), **here)


def _plain(run: str) -> str:
    """Return the name of a run that is part of a path; CheckError if it could lead elsewhere."""
    if not (run.isascii() and run.isalnum()):
        raise CheckError(f"not the orders of a process: the log is of run {run!r}")
    return run


def _name(orders: Orders) -> str:
    if isinstance(orders, KeeperConfig):
        return keeper_name(orders.keeper)
    return process_name(orders.process)


def _whereabouts(orders: Orders) -> str:
    return f", log {orders.log}" if isinstance(orders, KeeperConfig) else ""


@contextlib.contextmanager
def _node(orders: Orders) -> Generator[Node]:
    """Make the node; that of a keeper has its log open, which no other process has."""
    match orders:
        case ProcessConfig():
            yield HostNode(orders)
        case FreeProcessConfig():
            yield FreeHostNode(orders)
        case KeeperConfig():
            log = Path(orders.log)
            with _locked(log):
                if orders.incarnation > 1 and not log.exists():
                    raise InputError(
                        f"{log}: not there, expected what {_name(orders)} has logged in this run"
                        " before (join from the same folder)"
                    )
                with keeper_node(orders) as node:
                    yield node


def _locked(log: Path) -> contextlib.AbstractContextManager[object]:
    """Lock the log of a keeper; InputError if another process has it."""
    path = log.with_suffix(".lock")
    try:
        log.parent.mkdir(parents=True, exist_ok=True)
        return locked_file(path)
    except BlockingIOError:
        raise InputError(f"{log}: another keeper writes there, expected it to end first") from None
    except OSError as error:
        raise unwritable(path, error) from None


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


def _answered(
    session: zenoh.Session, key: str, request: JoinRequest, run: str, liveness: Liveness
) -> bytes:
    """Ask until the run answers; it offers a place when all that it waits for are there."""
    data = msgspec.json.encode(request)
    while True:
        begun = time.monotonic()
        for reply in session.get(key, payload=data, timeout=ASK_S):
            if reply.ok is not None:
                return reply.ok.payload.to_bytes()
            if reply.err is not None and not _is_timeout(reply.err):
                line = reply.err.payload.to_string()
                raise CheckError(line) if line == ENDED else InputError(line)
        _check_there(liveness, run)
        time.sleep(max(0.0, min(_POLL_S, begun + ASK_S - time.monotonic())))


def _is_timeout(error: zenoh.ReplyError) -> bool:
    return error.payload.to_string() == "Timeout"


def _check_there(
    liveness: Liveness, run: str, gone_s: float = GONE_S, alone_s: float = SETTLE_S
) -> None:
    if liveness.is_alone(alone_s):
        raise _gone("router", run)
    if liveness.gone(gone_s):
        raise _gone("coordinator", run)


def _gone(what: str, run: str) -> CheckError:
    return CheckError(f"the {what} of run {run} is gone")


def _serve(
    session: zenoh.Session, orders: Orders, node: Node, liveness: Liveness, patience_s: float
) -> None:
    """Serve until the run stops, its coordinator has died, or nothing arrives for this long.

    A host that is cut off may come back. Without rounds nobody needs the coordinator: so processes
    end only when router or coordinator are gone for this long.
    """
    begun = time.monotonic()
    heard: list[float] = []

    def note(_: zenoh.Sample) -> None:
        heard[:] = [time.monotonic()]

    # The coordinator says `go`, to whom it may, as long as it waits for anyone.
    key, in_rounds = topic_key(orders.run, "go"), isinstance(orders, ProcessConfig)
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
            if not in_rounds:
                _check_there(liveness, orders.run, patience_s, patience_s)
                continue
            if liveness.gone(heard=heard[0] if heard else math.inf):
                raise _gone("coordinator", orders.run)
            # Before the first round others are still being started.
            due = heard[0] + patience_s if heard else begun + max(patience_s, PATIENCE_S)
            if now > due:
                raise CheckError(f"nothing was heard of run {orders.run} for {patience_s:g} s")
