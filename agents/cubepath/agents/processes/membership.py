"""Processes that join a run from elsewhere: their requests, the offers, and who is alive.

A process asks for its configuration with a zenoh get on ``cubepath/RUN/orders/process_N``,
``.../keeper_K`` or ``.../any``. The answer is a `JoinOffer`, or an error of one line; neither is
recorded. A process repeats its request every `ASK_S`, so one that has been silent for `FORGET_S`
counts as gone.

Zenoh's liveliness tokens show who is alive, across restarts of the router.

In a run without rounds another process can take a place while the run goes on, and one that leaves
can give its place back. The modules of a place never change.
"""

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from queue import SimpleQueue
from typing import Annotated, Literal, TypeVar

import msgspec
import zenoh

from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.sites import site_hook
from cubepath.protocol.wire.credentials import keeper_name, process_name
from cubepath.protocol.wire.keys import topic_key
from cubepath.protocol.wire.messages import Count, Name
from cubepath.protocol.wire.sessions import LEASE_S, routers_of, watch

GONE_S = 3.0
"""A token that is absent for this long, at a router that answers, has gone; one whose session
connects anew, perhaps to another router, is back by then."""
SETTLE_S = 10.0
"""Within this time sessions find a router that came back, and declare their tokens again."""
SILENT_S = LEASE_S / 2
"""A process that dies takes its token with it. One whose token goes when nothing was heard of it
for this long is cut off: it may come back."""


class Liveness:
    """Which tokens of a key expression were there, and are there no more.

    While a router is away all of them are; so none has gone before sessions could find it again.
    """

    def __init__(self, session: zenoh.Session, key: str, *expected: str) -> None:
        """Watch the tokens from now on, those that are there already included.

        A token that is `expected` has gone if it was never seen.
        """
        self._session = session
        self._absent: dict[str, float | None] = dict.fromkeys(expected, time.monotonic())
        self._changes: SimpleQueue[tuple[str, bool]] = SimpleQueue()
        self._routers = routers_of(session)
        self._changed_s = time.monotonic() - SETTLE_S
        self._subscriber = watch(session, key, lambda *change: self._changes.put(change))

    def _look(self) -> float:
        """Note what has changed; return the time."""
        now = time.monotonic()
        while not self._changes.empty():
            key, alive = self._changes.get_nowait()
            if alive:
                self._absent[key] = None
            elif self._absent.get(key) is None:
                self._absent[key] = now
        routers = routers_of(self._session)
        if routers != self._routers:
            self._routers, self._changed_s = routers, now
        return now

    def gone(self, patience_s: float = GONE_S, heard: float = math.inf) -> list[str]:
        """Return the keys of tokens that have been absent for this long.

        Those are left out that went when nothing had been `heard` for `SILENT_S`.
        """
        now = self._look()
        if not self._routers or now - self._changed_s < SETTLE_S:
            return []
        absent = sorted(self._absent.items())
        return [
            key
            for key, since in absent
            if since is not None and now - since >= patience_s and since < heard + SILENT_S
        ]

    def expect(self, key: str) -> None:
        """Count a token as gone that is not there when sessions have had time to declare it."""
        if not self.is_there(key):
            self._absent[key] = time.monotonic() + SETTLE_S - GONE_S

    def is_there(self, key: str) -> bool:
        """Return whether a token is there."""
        self._look()
        return self._absent.get(key, 0.0) is None

    def is_alone(self, patience_s: float = SETTLE_S) -> bool:
        """Return whether there has been no router for this long: by default, to come back."""
        now = self._look()
        return not self._routers and now - self._changed_s >= patience_s


Config = TypeVar("Config", bound=msgspec.Struct)
PROTOCOL = 5
"""Changes with whatever must be the same in all processes of a run: messages, keys, phases."""
ANY = "any"
"""In place of a name: whatever number is free."""
_NOT_DECODED = (msgspec.MsgspecError, UnicodeDecodeError, RecursionError)
LOG_BYTES_MAX = 1 << 23
"""The most bytes of a keeper's log that are handed over: they travel in one message."""
ENDED = "the run has ended"
"""The error that those are answered who wait for a run that will not begin."""


class JoinRequest(msgspec.Struct, frozen=True):
    """A process asks to join with these modules, and later to begin, or to give its place back.

    A keeper that takes over a log asks to begin: it may have slept while another took its place.
    """

    modules: Annotated[list[Count], msgspec.Meta(max_length=1 << 16)]
    joiner: Name
    """The name of the process that asks: chosen once, and the same when it asks again."""
    protocol: Count = 0
    wants: Literal["join", "begin", "leave"] = "join"
    log: Annotated[bytes, msgspec.Meta(max_length=LOG_BYTES_MAX)] = b""
    """What a keeper that leaves has logged."""


class JoinOffer(msgspec.Struct, frozen=True):
    """The orders of a process, to be read if the protocol is the reader's."""

    protocol: Count
    orders: msgspec.Raw
    clock: Literal["lockstep", "free"] = "lockstep"


def orders_key(run: str, name: str = "*") -> str:
    """Return the key on which a process of this name asks for orders."""
    return topic_key(run, "orders", name)


def alive_key(run: str, name: str = "*") -> str:
    """Return the key of the liveliness token of a process, or of the coordinator."""
    return topic_key(run, "alive", name)


def read_request(data: bytes) -> JoinRequest:
    """Return a request; InputError if it is none, or of another protocol."""
    try:
        found = msgspec.json.decode(data, type=JoinRequest)
    except _NOT_DECODED as error:
        raise InputError(f"not a request to join: {error}") from None
    if found.protocol != PROTOCOL:
        raise InputError(_other(found.protocol, PROTOCOL))
    return found


def read_offer(data: bytes) -> JoinOffer:
    """Return an offer; InputError if it is of another protocol, CheckError if it is none."""
    try:
        found = msgspec.json.decode(data, type=JoinOffer)
    except _NOT_DECODED as error:
        raise _no_orders(error) from None
    if found.protocol != PROTOCOL:
        raise InputError(_other(PROTOCOL, found.protocol))
    return found


def read_orders(orders: msgspec.Raw, kind: type[Config]) -> Config:
    """Return the orders in an offer; CheckError if they are not of this kind."""
    try:
        return msgspec.json.decode(orders, type=kind, dec_hook=site_hook)
    except _NOT_DECODED as error:
        raise _no_orders(error) from None


def _no_orders(error: Exception) -> CheckError:
    return CheckError(f"not the orders of a process: {error}")


def offer(orders: msgspec.Struct, clock: Literal["lockstep", "free"] = "lockstep") -> bytes:
    """Return an offer as bytes."""
    raw = msgspec.Raw(msgspec.json.encode(orders))
    return msgspec.json.encode(JoinOffer(PROTOCOL, raw, clock))


def _other(joiner: int, coordinator: int) -> str:
    return (
        f"the process that joins speaks protocol {joiner} of cubepath, the coordinator"
        f" {coordinator}: expected the same version of cubepath on both"
    )


ASK_S = 2.0
FORGET_S = 10.0
_KEEPER = keeper_name(0)[:-1]
_PLACES = 8
"""How many places are named that can be taken."""


@dataclass(slots=True)
class _Entry:
    modules: tuple[int, ...]
    """None of a keeper."""
    name: str | None
    heard_s: float


class Membership:
    """The joiners of one run, up to the number that is expected."""

    def __init__(self, modules: int, expected: int, keepers: int = 0) -> None:
        """Expect this many joiners for a scene with this many modules, keepers among them."""
        self._modules = modules
        self._expected = expected
        self._keepers = keepers
        self._entries: dict[str, _Entry] = {}
        self._names: dict[str, str] | None = None
        self.vacant: Mapping[str, Sequence[int]] = {}
        """The places that others may take, by name, with their modules."""

    @property
    def complete(self) -> bool:
        """Whether all that are expected are there."""
        return len(self._entries) == self._expected

    @property
    def missing(self) -> int:
        """Return how many are still expected."""
        return self._expected - len(self._entries)

    @property
    def free(self) -> list[int]:
        """Return the modules that nobody has taken, in order."""
        taken = {module for entry in self._entries.values() for module in entry.modules}
        return [module for module in range(self._modules) if module not in taken]

    @property
    def keepers(self) -> list[int]:
        """Return the keepers that have joined, in order."""
        return [k for k in range(self._keepers) if self._is_named(keeper_name(k))]

    def _is_named(self, name: str) -> bool:
        return any(entry.name == name for entry in self._entries.values())

    def ask(
        self, joiner: str, modules: Sequence[int], name: str | None, now_s: float
    ) -> str | None:
        """Let a joiner in, as a process with these modules or a keeper; return why not, if so.

        `joiner` says who asks; one that asks again changes nothing. `name` is ``process_N``,
        ``keeper_K``, or None for any process. When all are numbered, it can only take a vacant
        place, by its name or by its modules.
        """
        known = self._entries.get(joiner)
        if known is not None:
            known.heard_s = now_s
            return None
        if not self._expected and not self.vacant:
            return "the run waits for no processes, expected one that has --wait-for N"
        is_keeper = name is not None and name.startswith(_KEEPER)
        entry = _Entry(() if is_keeper else tuple(sorted(modules)), name, now_s)
        if self._names is not None:
            return self._succeed(self._names, joiner, entry)
        reason = None if is_keeper else self._wrong_modules(modules)
        reason = reason or self._wrong_name(name, is_keeper=is_keeper)
        if reason is None:
            self._entries[joiner] = entry
        return reason

    def _succeed(self, names: dict[str, str], joiner: str, entry: _Entry) -> str | None:
        """Let a joiner take a vacant place."""
        for name, found in self.vacant.items():
            modules = tuple(found)
            named = entry.name == name and entry.modules in ((), modules)
            if named or (entry.name is None and modules and entry.modules == modules):
                self.leave(name)
                names[joiner] = name
                self._entries[joiner] = _Entry(modules, name, entry.heard_s)
                self.vacant = {each: its for each, its in self.vacant.items() if each != name}
                return None
        places = [
            f"{name} ({spans(sorted(modules))})" if modules else name
            for name, modules in self.vacant.items()
        ]
        more = ", ..." if len(places) > _PLACES else ""
        if not places:
            return "the run has begun, and no place in it is free"
        return f"the run has begun, expected the place of {', '.join(places[:_PLACES])}{more}"

    def leave(self, name: str) -> None:
        """Let the joiner of this name go, if there is one."""
        names = self._names or {}
        for joiner in [each for each, place in names.items() if place == name]:
            del self._entries[joiner], names[joiner]

    def _wrong_modules(self, modules: Sequence[int]) -> str | None:
        strange = sorted({each for each in modules if not 0 <= each < self._modules})
        if strange or not modules:
            found = spans(strange) or "none"
            return f"modules {found}: the run has modules 0-{self._modules - 1}"
        if len(set(modules)) < len(modules):
            return "modules: one is named twice"
        taken = sorted(set(modules) - set(self.free))
        if taken:
            return f"modules {spans(taken)}: taken by another process"
        return None

    def _wrong_name(self, name: str | None, *, is_keeper: bool) -> str | None:
        if self.complete:
            return f"the run waits for {self._expected} processes, and they are there"
        if is_keeper and name not in [keeper_name(k) for k in range(self._keepers)]:
            has = f"keeper_0 to keeper_{self._keepers - 1}" if self._keepers else "no keepers"
            return f"{name}: the run has {has}"
        # Keepers take up places of those that are expected, and processes have no gap in theirs.
        last = self._expected - len(self.keepers) - is_keeper - 1
        names = [entry.name for entry in self._entries.values()]
        wanted = [each for each in (*names, name) if each and not each.startswith(_KEEPER)]
        known = [process_name(k) for k in range(last + 1)]
        for each in wanted:
            if each not in known:
                return f"{each}: those that join are process_0 to process_{last}"
        if name is not None and name in names:
            return f"{name}: there already"
        return None

    def forget(self, now_s: float) -> None:
        """Forget who has not asked for long, until the joiners are numbered."""
        if self._names is None:
            self._entries = {
                joiner: entry
                for joiner, entry in self._entries.items()
                if now_s - entry.heard_s < FORGET_S
            }

    def number(self) -> list[list[int]]:
        """Number the processes, once and for all; return the modules of each.

        A process that named itself has that number. The others have the rest,
        in the order of their first modules.
        """
        hosts = [joiner for joiner, entry in self._entries.items() if entry.modules]
        named = {self._entries[joiner].name: joiner for joiner in hosts}
        order = sorted(hosts, key=lambda joiner: self._entries[joiner].modules)
        unnamed = iter([each for each in order if self._entries[each].name is None])
        names = [process_name(k) for k in range(len(hosts))]
        joiners = [named[name] if name in named else next(unnamed) for name in names]
        self._names = dict(zip(joiners, names, strict=True))
        for joiner, entry in self._entries.items():
            if entry.name is not None:
                self._names[joiner] = entry.name
        return [list(self._entries[joiner].modules) for joiner in joiners]

    @property
    def names(self) -> list[str]:
        """Return the names of all joiners, none before they are numbered."""
        return sorted((self._names or {}).values())

    def name_of(self, joiner: str) -> str | None:
        """Return the name of a joiner, None before all are numbered."""
        return None if self._names is None else self._names.get(joiner)


def spans(modules: Sequence[int]) -> str:
    """Return modules in increasing order as ``0-7, 9``."""
    found: list[tuple[int, int]] = []
    for module in modules:
        if found and found[-1][1] == module - 1:
            found[-1] = found[-1][0], module
        else:
            found.append((module, module))
    return ", ".join(f"{a}" if a == b else f"{a}-{b}" for a, b in found)
