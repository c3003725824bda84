"""A link between one process and the router of a run, which a test can cut, slow down and falsify.

At its far end is a session that acts as a router, at its own socket, where the process connects. At
its near end is a client of the router of the run, with the credentials of the process. Messages,
liveliness tokens and queries pass in both directions, each in its order, through the rules of the
link. Neither the process nor the router notices the link.

One direction of a link carries messages in their order, through rules, from one session to another.
Zenoh's callbacks only enqueue; a thread does the work.
"""

import contextlib
import heapq
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import count
from queue import Empty, SimpleQueue
from typing import Any, Literal, Self, TypeAlias, cast

import zenoh

from cubepath.coordinator.testing.rules import Direction, Fate, Rule, fate_of
from cubepath.coordinator.testing.wire_messages import WireMessage
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.output_files import new_file
from cubepath.protocol.wire.credentials import (
    GUEST,
    PASSWORDS,
    Credentials,
    clear,
    discard,
    is_private,
    new_endpoint,
)
from cubepath.protocol.wire.messages import MESSAGE_BYTES_MAX
from cubepath.protocol.wire.sessions import open_client, open_router, publisher

WAITING_MAX = 1 << 16
WAITING_BYTES_MAX = 1 << 25
"""At most this many messages wait in a direction, and bytes of them."""
_BEHIND_S_MAX = 1.0
"""A message that others are to overtake waits for them no longer."""
_BRAKE_S = 0.001
"""From half of that on zenoh's thread, and so the sender, is slowed: others wait for it too."""
_PUBLISHERS_MAX = 512
_END_S_MAX = 10.0

Cut: TypeAlias = Literal["", "lost", "kept"]
Tap: TypeAlias = Callable[[WireMessage], None]
"""Called with each message before it is passed on, or when it is lost."""


@dataclass(slots=True, eq=False)
class _Put:
    """A message on its way."""

    key: str
    sample: zenoh.Sample
    size: int
    """In bytes, until it is counted as carried."""
    seen: WireMessage | None = None
    """What tap and rules see; None if nobody looks, or the process does not listen to it."""
    has_left: bool = False
    """Whether a copy of it has left."""


@dataclass(frozen=True, slots=True)
class _Do:
    """A token, a question or an answer on its way; nothing but a cut link holds it back."""

    act: Callable[[], None]


_Item: TypeAlias = _Put | _Do


class ProxyDirection:
    """One direction of a link: what comes in at one end is put at the other, in its order."""

    def __init__(
        self, direction: Direction, process: str, out: zenoh.Session, tap: Tap | None = None
    ) -> None:
        """Carry to the session `out`; `process` is the name at the far end."""
        self.direction: Direction = direction
        self.rules: list[Rule] = []
        self.passed = 0
        """How many messages were put at the other end, each copy counted."""
        self.overflowed = 0
        """How many were lost because too many waited."""
        self.error: BaseException | None = None
        """What a rule raised first."""
        self.broken: Exception | None = None
        """What carrying something raised first."""
        self.cut: Cut = ""
        self._receiver = process if direction == "down" else ""
        self._process = process
        self._tap = tap
        self._out = out
        self._bytes_in, self._bytes_out = 0, 0  # each counted by one thread alone
        self._queue: SimpleQueue[_Item | None] = SimpleQueue()
        self._line: deque[tuple[float, _Item]] = deque()
        self._late: list[tuple[float, int, _Item]] = []
        self._behind: list[tuple[int, float, _Item]] = []
        self._held: dict[int, tuple[Rule, deque[_Item]]] = {}
        self._waits: deque[_Item] = deque()
        self._number = count()
        self._inside = 0
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._closed = False
        self._thread = threading.Thread(
            target=self._work, name=f"link {process} {direction}", daemon=True
        )
        self._thread.start()

    def take(self, sample: zenoh.Sample) -> None:
        """Take a message; a callback of zenoh."""
        waiting, inside = self._queue.qsize() + self._inside, self._bytes_in - self._bytes_out
        if waiting >= WAITING_MAX or inside >= WAITING_BYTES_MAX:
            self.overflowed += 1
            return
        if waiting > WAITING_MAX / 2 or inside > WAITING_BYTES_MAX / 2:
            time.sleep(_BRAKE_S)
        size = len(sample.payload) + len(sample.attachment or b"")
        self._bytes_in += size
        self._queue.put(_Put(str(sample.key_expr), sample, size))

    def do(self, act: Callable[[], None]) -> None:
        """Take something that is no message."""
        self._queue.put(_Do(act))

    def listens(self, key: str) -> bool:
        """Return whether anyone at the other end listens to any key of an expression."""
        with publisher(self._out, key) as asked:
            return bool(cast("Any", asked.matching_status).matching)

    def wake(self) -> None:
        """Look again at what waits."""
        self._queue.put(_Do(lambda: None))

    def close(self) -> None:
        """Carry nothing any more."""
        self._closed = True
        self.wake()
        self._queue.put(None)
        self._thread.join(_END_S_MAX)
        for declared in self._publishers.values():
            with contextlib.suppress(zenoh.ZError):
                declared.undeclare()
        self._publishers.clear()

    def _work(self) -> None:
        while not self._closed:
            with contextlib.suppress(Empty):
                item = self._queue.get(timeout=self._wait_s())
                if item is None:
                    return
                self._sort(item)
                item = None  # a question is over when nobody holds it
            self._carry_what_is_due()
            held = sum(len(each) for _, each in self._held.values())
            self._inside = held + len(self._line) + len(self._late) + len(self._behind)

    def _wait_s(self) -> float | None:
        """Return for how long nothing is due; None if nothing is before something comes."""
        if self.cut == "kept":
            return None  # healing it wakes it
        due = [until for _, until, _ in self._behind]
        due += [each[0][0] for each in (self._line, self._late) if each]
        due += [rule.until for rule, _ in self._held.values() if rule.until is not None]
        return max(0.0, min(due) - time.monotonic()) if due else None

    def _sort(self, item: _Item) -> None:
        """Let the rules decide on what has come, and put it where it waits for its time."""
        now = time.monotonic()
        if isinstance(item, _Put):
            self._behind = [(left - 1, until, each) for left, until, each in self._behind]
            try:
                self._look_at(item)
            except zenoh.ZError as error:
                self.broken = self.broken or error
        fate = self._fate(item.seen) if isinstance(item, _Put) and item.seen is not None else None
        if fate is None or not isinstance(item, _Put):
            self._line.append((now, item))
            return
        if fate.dropped:
            self._leave(item, lost=True)
            return
        if fate.holder is not None:
            held = self._held.setdefault(id(fate.holder), (fate.holder, deque()))
            held[1].append(item)
        elif fate.behind:
            self._behind.append((fate.behind, now + _BEHIND_S_MAX, item))
        elif fate.late_s and fate.overtaken:
            self._later(now + fate.late_s, item)
        else:
            self._line.append((now + fate.late_s, item))
        for late_s in fate.copies:
            if late_s:
                self._later(now + late_s, item)
            else:
                self._line.append((now, item))

    def _later(self, due: float, item: _Item) -> None:
        heapq.heappush(self._late, (due, next(self._number), item))

    def _look_at(self, item: _Put) -> None:
        if self._tap is None and not self.rules:
            return
        if self._receiver and not self._is_heard(item.key):
            return  # the process does not listen to it
        sample = item.sample
        data = sample.payload.to_bytes()
        if self._tap is None:
            item.seen = WireMessage(item.key, data, time.monotonic())
            return
        attached = sample.attachment
        item.seen = WireMessage(
            item.key,
            data,
            time.time(),
            encoding=str(sample.encoding),
            attachment=None if attached is None else attached.to_bytes(),
            deletes=sample.kind == zenoh.SampleKind.DELETE,
            link=self._process,
            down=self.direction == "down",
        )

    def _leave(self, item: _Put, *, lost: bool) -> None:
        self._bytes_out += item.size
        item.size = 0
        if self._tap is not None and item.seen is not None:
            now = time.time()
            self._tap(replace(item.seen, at_s=now, lost=lost, copied=item.has_left))
        item.has_left = True

    def _fate(self, seen: WireMessage) -> Fate | None:
        try:
            return fate_of(self.rules, seen, self._receiver)
        except BaseException as error:  # noqa: BLE001 - of a rule's `where`: told by `check`
            self.error = self.error or error
            return None

    def _carry_what_is_due(self) -> None:
        if self.cut == "kept":
            return
        for item in self._due(time.monotonic()):
            self._carry(item)

    def _due(self, now: float) -> Iterator[_Item]:
        """Yield what is to be put now, in order, and forget it."""
        while self._waits and not self.cut:
            yield self._waits.popleft()
        for key, (rule, held) in list(self._held.items()):
            if rule.until is not None and rule.until <= now:
                rule.stop()
            if not rule.on:
                del self._held[key]
                yield from held
        while self._line and self._line[0][0] <= now:
            yield self._line.popleft()[1]
        while self._late and self._late[0][0] <= now:
            yield heapq.heappop(self._late)[2]
        behind, self._behind = self._behind, []
        for each in behind:
            if each[0] > 0 and each[1] > now:
                self._behind.append(each)
            else:
                yield each[2]

    def _carry(self, item: _Item) -> None:
        lost = self.cut == "lost"
        if isinstance(item, _Put):
            self._leave(item, lost=lost)
        if lost:
            if isinstance(item, _Do):
                self._waits.append(item)
            return
        try:
            self._put(item)
        except zenoh.ZError:
            pass  # the router may be gone, as for the process itself
        except Exception as error:  # noqa: BLE001 - told by `check`; the others are to be carried
            self.broken = self.broken or error

    def _put(self, item: _Item) -> None:
        if isinstance(item, _Do):
            item.act()
            return
        sample = item.sample
        found = self._publisher(item.key)
        with_it: dict[str, Any] = {
            "attachment": sample.attachment,
            "timestamp": sample.timestamp,
            "source_info": sample.source_info,
        }
        if sample.kind == zenoh.SampleKind.DELETE:
            found.delete(**with_it)
        else:
            found.put(sample.payload, encoding=sample.encoding, **with_it)
        self.passed += 1

    def _publisher(self, key: str) -> zenoh.Publisher:
        """Return the publisher of a key."""
        found = self._publishers.pop(key, None)
        if found is None:
            if len(self._publishers) >= _PUBLISHERS_MAX:
                self._publishers.pop(next(iter(self._publishers))).undeclare()
            found = publisher(self._out, key)
        self._publishers[key] = found
        return found

    def _is_heard(self, key: str) -> bool:
        """Return whether anyone at the other end listens to a key."""
        # An object, which is always true; zenoh's stub declares a bool.
        return bool(cast("Any", self._publisher(key).matching_status).matching)


ALL = "**"
_ASK_S_MAX = 60.0
_ON_LOOPBACK = "tcp/127.0.0.1:0"


class LinkProxy:
    """A link, as a context manager that takes it away.

    >>> with LinkProxy("process_0", endpoint, credentials) as link:   # doctest: +SKIP
    ...     start_the_process_at(link.endpoint)
    ...     link.add(Rule(action="drop", pattern=Pattern(kind="bundle"), times=3))
    """

    def __init__(
        self, name: str, endpoint: str, credentials: Credentials = GUEST, *, tap: Tap | None = None
    ) -> None:
        """Stand between the process of this name and the router at an endpoint.

        With a private router the process shows its own credentials to both. Otherwise the link
        listens at a port of this machine. InputError if the endpoint takes certificates.

        A `tap` is for processes that are no part of a run: it is called with all that happens to
        their messages, by the threads of the link, and they may answer queries.
        """
        if not isinstance(endpoint, str):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise InputError(f"endpoint={endpoint!r}: expected where the router is")
        if endpoint.startswith("tls/"):
            raise InputError(
                f"endpoint {endpoint}: a link has no certificate, expected tcp/HOST:PORT"
            )
        self.name = name
        self.warning = ""
        """What the process did by which rules and cuts may miss its messages, or empty."""
        self._tokens: dict[tuple[Direction, str], zenoh.LivelinessToken | None] = {}
        """What is shown by each direction; None while it is being declared."""
        self._lock = threading.Lock()
        self._resources = contextlib.ExitStack()
        self._tap = tap
        try:
            self._open(endpoint, credentials)
        except BaseException:
            self.close()
            raise

    def _open(self, endpoint: str, credentials: Credentials) -> None:
        guard: dict[str, Any] = {}
        where = _ON_LOOPBACK
        if is_private(endpoint):
            where = new_endpoint()
            self._resources.callback(discard, where)
            words = clear(where) / PASSWORDS
            named = {GUEST.name: GUEST.password, credentials.name: credentials.password}
            with new_file(words, 0o600) as file:
                file.write("".join(f"{name}:{word}\n" for name, word in named.items()).encode())
            guard["transport/auth/usrpwd/dictionary_file"] = str(words)
        near = open_client(endpoint, None, credentials=credentials)
        self._resources.callback(near.close)
        far, self.endpoint = open_router(where, guard, MESSAGE_BYTES_MAX)
        self._resources.callback(far.close)
        self._far = far
        far.info.declare_transport_events_listener(_callback(self._connected))
        self.up = ProxyDirection("up", self.name, near, self._tap)
        self._resources.callback(self.up.close)
        self.down = ProxyDirection("down", self.name, far, self._tap)
        self._resources.callback(self.down.close)
        self._listen(near, self.down)
        self._listen(far, self.up)
        self._watch(near, far, self.down)
        self._watch(far, near, self.up)
        far.declare_queryable(ALL, _callback(lambda query: self._asked(query, near, self.up)))
        if self._tap is not None:
            near.declare_queryable(ALL, _callback(lambda query: self._asked(query, far, self.down)))

    def _listen(self, session: zenoh.Session, lane: ProxyDirection) -> None:
        # What a session puts itself does not come back to it.
        session.declare_subscriber(ALL, _callback(lane.take), allowed_origin=zenoh.Locality.REMOTE)

    def _watch(self, one: zenoh.Session, other: zenoh.Session, lane: ProxyDirection) -> None:
        """Show at one end the liveliness tokens of the other."""
        back: Direction = "up" if lane.direction == "down" else "down"

        def changed(sample: zenoh.Sample) -> None:
            key, there = str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT
            lane.do(lambda: show(key, there))

        def show(key: str, there: bool) -> None:  # noqa: FBT001 - as zenoh tells it
            with self._lock:
                if (back, key) in self._tokens:
                    return  # it is shown here by the other direction
                known = self._tokens.get((lane.direction, key))
                if there and known is None:
                    self._tokens[lane.direction, key] = None
                elif not there:
                    self._tokens.pop((lane.direction, key), None)
            if there and known is None:
                self._tokens[lane.direction, key] = other.liveliness().declare_token(key)
            elif known is not None and not there:
                known.undeclare()

        one.liveliness().declare_subscriber(ALL, _callback(changed), history=True)

    def _asked(self, query: zenoh.Query, other: zenoh.Session, way: ProxyDirection) -> None:
        """Pass a question on to the session at the other end, and each answer back."""
        back = self.down if way is self.up else self.up

        def answered(reply: zenoh.Reply) -> None:
            back.do(lambda: _pass_on(query, reply))

        def ask() -> None:
            other.get(
                query.selector,
                _callback(answered),
                payload=query.payload,
                encoding=query.encoding,
                attachment=query.attachment,
                timeout=_ASK_S_MAX,
                allowed_destination=zenoh.Locality.REMOTE,
            )

        way.do(ask)

    def listens(self, key: str) -> bool:
        """Return whether the process listens to any key of an expression."""
        return self.down.listens(key)

    @property
    def subscribes(self) -> str:
        """Whether the process has connected, and subscribes to anything, in words."""
        if not [*self._far.info.transports()]:
            return "has not connected"
        return f"is connected, and subscribes to {'other keys' if self.listens(ALL) else 'nothing'}"

    def _connected(self, event: zenoh.TransportEvent) -> None:
        if event.transport.whatami == zenoh.WhatAmI.PEER:
            self.warning = "is a peer, which may go past its link, expected mode client"

    def add(self, rule: Rule, directions: Iterable[Direction] = ("up", "down")) -> Rule:
        """Have a rule decide on the messages of these directions from now on; return it."""
        for direction in directions:
            found = self.up if direction == "up" else self.down
            rule.on_stop(found.wake)
            found.rules = [*found.rules, rule]
        return rule

    @property
    def speaks_as(self) -> str:
        """Return the name by which the process at the far end speaks: that of its token, if any."""
        with self._lock:
            alive = [key for way, key in self._tokens if way == "up" and "/alive/" in key]
        return alive[0].rpartition("/")[2] if alive and self._tap is None else self.name

    def clear(self) -> None:
        """Take all rules away, and heal the link; what is held back passes."""
        for lane in (self.up, self.down):
            for rule in lane.rules:
                rule.stop()
            lane.rules, lane.error, lane.broken = [], None, None
        self.heal()

    def cut(self, *, keep: bool = False) -> None:
        """Let nothing through in either direction.

        Messages sent meanwhile are lost or, if kept, arrive when the link is healed. Signs of
        life, and questions, are kept in both cases: neither side is notified that the link is cut.
        """
        self._cut("kept" if keep else "lost")

    def heal(self) -> None:
        """Let everything through again."""
        self._cut("")

    def _cut(self, how: Cut) -> None:
        for lane in (self.up, self.down):
            lane.cut = how
            lane.wake()

    def check(self) -> None:
        """Raise CheckError if a rule raised, or messages were lost because too many waited."""
        for lane in (self.up, self.down):
            link, way = f"the link of {self.name}", f"on the way {lane.direction}"
            if lane.error is not None:
                raise CheckError(f"a rule of {link} raised {lane.error!r}") from lane.error
            if lane.broken is not None:
                raise CheckError(f"{link} raised {lane.broken!r} {way}") from lane.broken
            if lane.overflowed:
                limits = f"more than {WAITING_MAX}, or {WAITING_BYTES_MAX >> 20} MiB, waited"
                raise CheckError(f"{link} lost {lane.overflowed} messages {way}: {limits}")

    def close(self) -> None:
        """Take the link away."""
        self._resources.close()
        self._tokens.clear()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _callback(act: Callable[[Any], object]) -> Any:
    return zenoh.handlers.Callback(act, indirect=False)


def _pass_on(query: zenoh.Query, reply: zenoh.Reply) -> None:
    if reply.ok is not None:
        query.reply(reply.ok.key_expr, reply.ok.payload, encoding=reply.ok.encoding)
    elif reply.err is not None and reply.err.payload.to_string() != "Timeout":
        query.reply_err(reply.err.payload, encoding=reply.err.encoding)
