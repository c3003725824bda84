"""What was heard and waits to be written: a bounded queue of zenoh's, and what is taken from it.

The queue is filled without Python, whose threads would otherwise take turns at every message; who
fills a full one waits, so publishers that block are held up by the link.

The last seconds of what was heard, bounded: the oldest go first.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

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
    """Who numbers its messages, and the number of this one."""


class Backlog:
    """What came on a key expression and was not taken yet, of so many bytes at most."""

    def __init__(self, session: zenoh.Session, key: str, bytes_max: int) -> None:
        """Listen from now on."""
        self.most = max(_QUEUE_MIN, min(bytes_max // _QUEUED_BYTES, _QUEUE_MAX))
        """So many messages wait at most."""
        queue: Any = zenoh.handlers.FifoChannel(self.most)
        self._subscriber = session.declare_subscriber(key, queue)

    def take(self, seconds: float) -> Iterator[ReceivedMessage]:
        """Yield what waits, for so long at most; wait a moment if there is nothing."""
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
    told = sample.source_info
    source = None
    if told is not None:
        of = told.source_id
        source = f"{of.zid}/{of.eid}", int(told.source_sn)
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
    """What came in the last seconds, and takes no more than so many bytes."""

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
