"""Messages received and waiting to be written, and which messages never arrived.

Zenoh fills the queue without Python, whose threads would otherwise take turns at every message. A
sender that fills it waits, so the link holds up publishers that block.

With rounds, a process says with `ready` how many messages it has sent to each region; without
rounds, senders number their messages. A publisher that adds zenoh's `SourceInfo` numbers its
messages as well. A message that arrives late is no longer missing.
"""

import threading
import time
from collections import Counter, deque
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import msgspec
import zenoh

OVERHEAD_BYTES = 200
"""What a message takes beside its bytes, once it was taken."""
_QUEUED_BYTES = 4096
"""What a message takes in the queue, a page of memory: most are smaller."""
_QUEUE_MIN, _QUEUE_MAX = 4, 1 << 17
_IDLE_S = 0.01


class ReceivedMessage(NamedTuple):
    """A message as it came."""

    key: str
    data: bytes
    wall_ns: int
    source: tuple[str, int] | None
    """The publisher that numbers its messages, and the number of this one."""


class Backlog:
    """What came on a key expression and was not taken yet, of this many bytes at most."""

    def __init__(self, session: zenoh.Session, key: str, bytes_max: int) -> None:
        """Listen from now on."""
        self.most = max(_QUEUE_MIN, min(bytes_max // _QUEUED_BYTES, _QUEUE_MAX))
        """At most this many messages wait."""
        queue: Any = zenoh.handlers.FifoChannel(self.most)
        self._subscriber = session.declare_subscriber(key, queue)

    def take(self, seconds: float) -> Iterator[ReceivedMessage]:
        """Yield what waits, for at most this long; wait a moment if there is nothing."""
        take = self._subscriber.try_recv
        until = time.monotonic() + seconds
        found = take()
        if found is None:
            time.sleep(min(_IDLE_S, seconds))
            found = take()
        while found is not None:
            if found.kind == zenoh.SampleKind.PUT:
                yield _heard(found)
            if time.monotonic() > until:
                return
            found = take()

    @contextmanager
    def emptied(self) -> Generator[None]:
        """Throw away what comes during the block: a session whose queue is full cannot close."""
        over = threading.Event()

        def empty() -> None:
            while not over.is_set():
                try:
                    found = self._subscriber.try_recv()
                except zenoh.ZError:  # the session has closed
                    return
                if found is None:
                    over.wait(_IDLE_S)

        thread = threading.Thread(target=empty, name="cubepath-recorder-leaves", daemon=True)
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join()


def _heard(sample: zenoh.Sample) -> ReceivedMessage:
    info = sample.source_info
    source = None
    if info is not None:
        publisher = info.source_id
        source = f"{publisher.zid}/{publisher.eid}", int(info.source_sn)
    return ReceivedMessage(str(sample.key_expr), sample.payload.to_bytes(), time.time_ns(), source)


class RecordedMessage(NamedTuple):
    """A message as it will stand in a recording."""

    topic: str
    data: bytes
    at: int
    wall_ns: int
    begins: int
    """The first whole round of a recording that begins with it."""


class RecentMessages:
    """What came in the last seconds, and takes no more than this many bytes."""

    def __init__(self, seconds: float, bytes_max: int) -> None:
        """Begin empty."""
        self._span_ns = int(seconds * 1e9)
        self._most = bytes_max
        self._kept: deque[RecordedMessage] = deque()
        self._bytes = 0
        self.dropped = 0
        """How many went before their time, for want of memory."""

    def put(self, kept: RecordedMessage) -> None:
        """Put a message behind the others, and let go what is too old."""
        self._kept.append(kept)
        self._bytes += len(kept.data) + OVERHEAD_BYTES
        self._let_go(kept.wall_ns)
        while self._bytes > self._most and len(self._kept) > 1:
            self._forget()
            self.dropped += 1

    def _let_go(self, now_ns: int) -> None:
        while self._kept and self._kept[0].wall_ns < now_ns - self._span_ns:
            self._forget()

    def _forget(self) -> None:
        self._bytes -= len(self._kept.popleft().data) + OVERHEAD_BYTES

    def at(self, now_ns: int) -> tuple[RecordedMessage, ...]:
        """Return what came in the last seconds before a wall time, in nanoseconds."""
        self._let_go(now_ns)
        return tuple(self._kept)


_MISSING_MAX = 100_000
"""This many missing numbers of a sender are remembered; more are counted, and never come."""
_PHASES_MAX = 64


class Head(msgspec.Struct, gc=False):
    """What is read of a message of a run with rounds."""

    round: int = 0
    phase: str | None = None
    process: int = 0
    region: str = ""
    number: int = 0
    sent: dict[str, int] = {}


class _FreeHead(msgspec.Struct, gc=False):
    incarnation: int = 0
    sequence: int = 0


_head = msgspec.json.Decoder(Head).decode
_free_head = msgspec.json.Decoder(_FreeHead).decode
_NO_HEAD = (msgspec.DecodeError, UnicodeDecodeError, RecursionError)


class _Numbers:
    """The numbers of one sender, from the first that was heard on."""

    def __init__(self, first: int) -> None:
        self._next = first + 1
        self._missing: set[int] = set()
        self._beyond = 0

    def take(self, number: int) -> None:
        if number < self._next:
            self._missing.discard(number)
            return
        gap = number - self._next
        if len(self._missing) + gap > _MISSING_MAX:
            self._beyond += gap
        else:
            self._missing.update(range(self._next, number))
        self._next = number + 1

    @property
    def missing(self) -> int:
        return len(self._missing) + self._beyond


class LossCounter:
    """Counts what is missing of a run, by sender."""

    def __init__(self, *, free: bool) -> None:
        """Begin with nothing heard, of a run without rounds or with them."""
        self._free = free
        self._sources: dict[str, _Numbers] = {}
        self._incarnations: dict[tuple[str, int], _Numbers] = {}
        self._numbers: dict[str, dict[tuple[int, str | None, str], set[int]]] = {}
        self._owed: dict[str, Counter[tuple[int, str | None, str]]] = {}
        self._reported: dict[str, int] = {}
        self._unreported: Counter[str] = Counter()
        self._first_round: int | None = None

    def take(self, topic: str, heard: ReceivedMessage) -> Head | None:
        """Note a message; return what was read of it, None if it is malformed."""
        if heard.source is not None:
            publisher, number = heard.source
            known = self._sources.get(publisher)
            if known is None:
                self._sources[publisher] = _Numbers(number)
            else:
                known.take(number)
        kind, _, sender = topic.partition("/")
        try:
            if self._free:
                self._numbered(kind, sender, heard.data)
                return None
            head = _head(heard.data)
        except _NO_HEAD:
            return None
        if self._first_round is None:
            self._first_round = head.round
        match kind:
            case "bundle":
                self._take_number(sender, head)
            case "ready":
                self._take_ready(sender, head)
            case "reports":
                self._take_reports(sender, head.round)
            case _:
                pass
        return head

    def _numbered(self, kind: str, sender: str, data: bytes) -> None:
        head = _free_head(data)
        if not head.sequence or kind in (
            "halted",
            "commits",
        ):  # these tell the last number, and have none
            return
        key = sender, head.incarnation
        known = self._incarnations.get(key)
        if known is None:
            self._incarnations[key] = _Numbers(head.sequence)
        else:
            known.take(head.sequence)

    def _take_number(self, sender: str, head: Head) -> None:
        key = head.round, head.phase, head.region
        owed = self._owed.get(sender)
        if owed and owed[key] > 0:
            owed[key] -= 1
            return
        numbers = self._numbers.setdefault(sender, {})
        numbers.setdefault(key, set()).add(head.number)
        if len(numbers) > _PHASES_MAX * 64:
            numbers.clear()  # without a `ready` nothing tells what belongs to them

    def _take_ready(self, sender: str, head: Head) -> None:
        numbers = self._numbers.pop(sender, {})
        if head.round == self._first_round:
            return  # what was said before anyone listened is not lost
        for region, count in head.sent.items():
            key = head.round, head.phase, region
            missing = count - len(numbers.get(key, ()))
            if missing > 0:
                self._owed.setdefault(sender, Counter())[key] = missing

    def _take_reports(self, sender: str, number: int) -> None:
        before = self._reported.get(sender)
        if before is not None and number > before + 1:
            self._unreported[f"reports/{sender}"] += number - before - 1
        self._reported[sender] = max(number, before or 0)

    def by_sender(self) -> dict[str, int]:
        """Return how many messages are missing, by topic, sender or publisher."""
        found: Counter[str] = Counter(self._unreported)
        for sender, owed in self._owed.items():
            found[f"bundle/{sender}"] += owed.total()
        for (sender, _), numbers in self._incarnations.items():
            found[sender] += numbers.missing
        for publisher, numbers in self._sources.items():
            found[publisher] += numbers.missing
        return {each: found[each] for each in sorted(found) if found[each]}
