"""Processes that join a run from elsewhere: their requests, the offers, and who is alive.

A process asks for its configuration with a zenoh get on ``cubepath/RUN/orders/process_N``, or
``.../any``. The answer is a `JoinOffer`, or an error of one line; neither is recorded. A process
repeats its request every `ASK_S`, so one that has been silent for `FORGET_S` counts as gone.

Zenoh's liveliness tokens show who is alive, across restarts of the router.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from queue import SimpleQueue
from typing import Annotated

import msgspec
import zenoh

from cubepath.agents.processes.config import ProcessConfig
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.sites import site_hook
from cubepath.protocol.wire.keys import topic_key
from cubepath.protocol.wire.messages import Count, Name
from cubepath.protocol.wire.sessions import routers_of, watch

GONE_S = 1.0
"""A token that is absent for this long, at a router that answers, has gone."""
SETTLE_S = 10.0
"""Within this time sessions find a router that came back, and declare their tokens again."""


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

    def gone(self) -> list[str]:
        """Return the keys of tokens that seem to have gone permanently."""
        now = self._look()
        if not self._routers or now - self._changed_s < SETTLE_S:
            return []
        absent = sorted(self._absent.items())
        return [key for key, since in absent if since is not None and now - since >= GONE_S]

    def is_alone(self) -> bool:
        """Return whether there has been no router for longer than it takes to come back."""
        now = self._look()
        return not self._routers and now - self._changed_s >= SETTLE_S


PROTOCOL = 4
"""Changes with whatever must be the same in all processes of a run: messages, keys, phases."""
ANY = "any"
"""In place of a name: whatever number is free."""
_NOT_DECODED = (msgspec.MsgspecError, UnicodeDecodeError, RecursionError)
ENDED = "the run has ended"
"""The error that those are answered who wait for a run that will not begin."""


class JoinRequest(msgspec.Struct, frozen=True):
    """A process asks to join with these modules."""

    modules: Annotated[list[Count], msgspec.Meta(max_length=1 << 16)]
    joiner: Name
    """Who asks: made up once, and the same when it asks again."""
    protocol: Count = 0


class JoinOffer(msgspec.Struct, frozen=True):
    """The orders of a process, to be read if the protocol is the reader's."""

    protocol: Count
    orders: msgspec.Raw


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


def read_offer(data: bytes) -> ProcessConfig:
    """Return the orders of an offer; InputError if it is of another protocol, CheckError if bad."""
    try:
        found = msgspec.json.decode(data, type=JoinOffer)
        if found.protocol != PROTOCOL:
            raise InputError(_other(PROTOCOL, found.protocol))
        return msgspec.json.decode(found.orders, type=ProcessConfig, dec_hook=site_hook)
    except _NOT_DECODED as error:
        raise CheckError(f"not the orders of a process: {error}") from None


def offer(orders: ProcessConfig) -> bytes:
    """Return an offer as bytes."""
    return msgspec.json.encode(JoinOffer(PROTOCOL, msgspec.Raw(msgspec.json.encode(orders))))


def _other(joiner: int, coordinator: int) -> str:
    return (
        f"the process that joins speaks protocol {joiner} of cubepath, the coordinator"
        f" {coordinator}: expected the same version of cubepath on both"
    )


ASK_S = 2.0
FORGET_S = 10.0


@dataclass(slots=True)
class _Entry:
    modules: tuple[int, ...]
    name: int | None
    heard_s: float


class Membership:
    """The joiners of one run, up to the number that is expected."""

    def __init__(self, modules: int, expected: int) -> None:
        """Expect this many joiners for a scene with this many modules."""
        self._modules = modules
        self._expected = expected
        self._entries: dict[str, _Entry] = {}
        self._numbers: dict[str, int] | None = None

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

    def ask(
        self, joiner: str, modules: Sequence[int], name: int | None, now_s: float
    ) -> str | None:
        """Let a joiner in with these modules, as process `name` or any; return why not, if so.

        `joiner` says who asks; one that asks again changes nothing.
        """
        known = self._entries.get(joiner)
        if known is not None:
            known.heard_s = now_s
            return None
        if not self._expected:
            return "the run waits for no processes, expected one that has --wait-for N"
        if self._numbers is not None:
            return "the run has begun"
        reason = self._wrong_modules(modules) or self._wrong_name(name)
        if reason is None:
            self._entries[joiner] = _Entry(tuple(sorted(modules)), name, now_s)
        return reason

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

    def _wrong_name(self, name: int | None) -> str | None:
        if self.complete:
            return f"the run waits for {self._expected} processes, and they are there"
        if name is not None and not 0 <= name < self._expected:
            return f"process_{name}: those that join are process_0 to process_{self._expected - 1}"
        if name is not None and name in (entry.name for entry in self._entries.values()):
            return f"process_{name}: there already"
        return None

    def forget(self, now_s: float) -> None:
        """Forget who has not asked for long, until the joiners are numbered."""
        if self._numbers is None:
            self._entries = {
                joiner: entry
                for joiner, entry in self._entries.items()
                if now_s - entry.heard_s < FORGET_S
            }

    def number(self) -> list[list[int]]:
        """Number the joiners, once and for all; return the modules of each.

        Who named itself has that number. The others have what is left, by their first modules.
        """
        named = {entry.name: joiner for joiner, entry in self._entries.items()}
        order = sorted(self._entries, key=lambda joiner: self._entries[joiner].modules)
        unnamed = iter([each for each in order if self._entries[each].name is None])
        joiners = [named[k] if k in named else next(unnamed) for k in range(len(order))]
        self._numbers = {joiner: number for number, joiner in enumerate(joiners)}
        return [list(self._entries[joiner].modules) for joiner in joiners]

    def number_of(self, joiner: str) -> int | None:
        """Return the number of a joiner, None before there is one."""
        return None if self._numbers is None else self._numbers.get(joiner)


def spans(modules: Sequence[int]) -> str:
    """Return modules in increasing order as ``0-7, 9``."""
    found: list[tuple[int, int]] = []
    for module in modules:
        if found and found[-1][1] == module - 1:
            found[-1] = found[-1][0], module
        else:
            found.append((module, module))
    return ", ".join(f"{a}" if a == b else f"{a}-{b}" for a, b in found)
