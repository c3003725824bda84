"""Messages received and waiting to be written.

Zenoh fills the queue without Python, whose threads would otherwise take turns at every message. A
sender that fills it waits, so the link holds up publishers that block.
"""

import threading
import time
from collections import deque
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from functools import lru_cache
from typing import Any, NamedTuple

import zenoh

from cubepath.protocol.recordings.plain_messages import PutSettings

OVERHEAD_BYTES = 200
"""What a message takes beside its bytes, once it was taken."""
_QUEUED_BYTES = 4096
"""What a message takes in the queue, a page of memory: most are smaller."""
_QUEUE_MIN, _QUEUE_MAX = 4, 1 << 17
_IDLE_S, _IDLE_S_ON_ANY_KEY = 0.01, 0.001
"""How long nobody looks when nothing waits; the second is how exact times of receipt are."""


class PlainParts(NamedTuple):
    """What there is of a message on any key beside its key and its bytes."""

    put: PutSettings
    sent_ns: int | None
    """The timestamp that its sender or its first router gave it; None without one."""
    attachment: bytes | None
    deleted: bool


class ReceivedMessage(NamedTuple):
    """A message as it came."""

    key: str
    data: bytes
    wall_ns: int
    source: tuple[str, int] | None
    """The publisher that numbers its messages, and the number of this one."""
    plain: PlainParts | None = None
    """What else there is of a message on any key; None for one of a run."""


class Backlog:
    """What came on a key expression and was not taken yet, of this many bytes at most."""

    def __init__(
        self, session: zenoh.Session, key: str, bytes_max: int, *, of_run: bool = True
    ) -> None:
        """Listen from now on: to a run, or to everything there is of messages on any keys."""
        self._heard = heard_of_run if of_run else heard_on_any_key
        self._idle_s = _IDLE_S if of_run else _IDLE_S_ON_ANY_KEY
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
            time.sleep(min(self._idle_s, seconds))
            found = take()
        while found is not None:
            taken = self._heard(found)
            if taken is not None:
                yield taken
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


def heard_of_run(sample: zenoh.Sample) -> ReceivedMessage | None:
    """Return a message of a run; None for a deletion, which is none."""
    if sample.kind != zenoh.SampleKind.PUT:
        return None
    return ReceivedMessage(
        str(sample.key_expr), sample.payload.to_bytes(), time.time_ns(), source_of(sample)
    )


def heard_on_any_key(sample: zenoh.Sample) -> ReceivedMessage:
    """Return a message on any key, or a deletion, with all that there is of it."""
    return ReceivedMessage(
        str(sample.key_expr),
        sample.payload.to_bytes(),
        time.time_ns(),
        source_of(sample),
        plain_parts(sample),
    )


def plain_parts(sample: zenoh.Sample) -> PlainParts:
    """Return what there is of a message beside its key and its bytes."""
    attached, stamp = sample.attachment, sample.timestamp
    return PlainParts(
        _settings(
            str(sample.encoding),
            str(sample.priority),
            str(sample.congestion_control),
            sample.express,
        ),
        None if stamp is None else stamp.get_time_as_ntp64().as_nanos(),
        None if attached is None else attached.to_bytes(),
        sample.kind == zenoh.SampleKind.DELETE,
    )


@lru_cache(1024)
def _settings(encoding: str, priority: str, congestion: str, express: bool) -> PutSettings:  # noqa: FBT001 - a key of the cache
    def name(text: str) -> str:  # "Priority.DATA" is data
        return text.rpartition(".")[2].lower()

    return PutSettings(encoding, name(priority), name(congestion), express)


def source_of(sample: zenoh.Sample) -> tuple[str, int] | None:
    """Return the publisher and the number of a message, if its publisher numbers them."""
    info = sample.source_info
    if info is None:
        return None
    publisher = info.source_id
    return f"{publisher.zid}/{publisher.eid}", int(info.source_sn)


class RecordedMessage(NamedTuple):
    """A message as it will stand in a recording."""

    topic: str
    data: bytes
    at: int
    wall_ns: int
    begins: int
    """The first whole round of a recording that begins with it."""
    sent_ns: int | None = None
    """When a message on any key was sent; `wall_ns` is when it was received."""
    put: PutSettings | None = None


class RecentMessages:
    """What came in the last seconds, and takes no more than this many bytes."""

    def __init__(self, seconds: float, bytes_max: int) -> None:
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
