"""A shell: it carries out on zenoh what a node asks for, and passes on what arrives.

Zenoh's callbacks only enqueue; `step` takes one message or tick from the queue, in order. Keys with
frequent messages have a declared publisher, which costs less than a put on the session.

Every child process of a run ends with its parent: its configuration comes in one line of JSON on
standard input, never on a command line, and when that input closes, the parent is gone.
"""

import contextlib
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from queue import Empty, SimpleQueue
from typing import Any, Self, TypeVar

import msgspec
import zenoh

from cubepath.protocol.core.errors import CubepathError
from cubepath.protocol.core.sites import site_hook
from cubepath.protocol.wire.credentials import GUEST, Credentials, discard
from cubepath.protocol.wire.nodes import (
    BatchNode,
    Effect,
    End,
    Ignore,
    Keep,
    Listen,
    Node,
    Put,
    Timer,
)
from cubepath.protocol.wire.sessions import open_client, publisher, routers_of, subscribe

TOLD = 4
"""Exit code of a process whose last line on standard error fully describes the error."""
_ORPHAN = 3

Config = TypeVar("Config", bound=msgspec.Struct)


def _end_with_parent(endpoint: str) -> None:
    # Not through sys.stdin: its lock would be held when the interpreter shuts down, and abort it.
    while os.read(0, 1):
        pass
    discard(endpoint)  # the router may have been killed too
    if os.getpgrp() == os.getpid():  # with what a rule has forked
        os.killpg(0, signal.SIGKILL)
    os._exit(_ORPHAN)


def serve(
    kind: type[Config], endpoint_of: Callable[[Config], str], work: Callable[[Config], None]
) -> int:
    """Read the configuration and work; print one line and return `TOLD` on failure."""
    # The coordinator handles interrupts; a terminal sends them to every process.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    config = msgspec.json.decode(sys.stdin.buffer.readline(), type=kind, dec_hook=site_hook)
    threading.Thread(target=_end_with_parent, args=(endpoint_of(config),), daemon=True).start()
    try:
        work(config)
    except CubepathError as error:
        print(error, file=sys.stderr)
        return TOLD
    return 0


_QUEUE_MAX, _QUEUE_BYTES_MAX = 1 << 16, 1 << 28
"""At most this many messages and bytes wait for a node: a flood takes no more memory, and what is
dropped of what the node waits for is asked for again."""
_BATCH_MAX = 64
"""At most this many messages are in a batch."""
_PUBLISHERS_MAX = 512
"""Publishers declared at one time; modules that wander come to ever new regions."""


class Shell:
    """One node on one session, as a context manager that closes it."""

    def __init__(
        self,
        node: Node,
        endpoint: str,
        keep: Callable[[Keep[Any], int], None] | None = None,
        *,
        credentials: Credentials = GUEST,
    ) -> None:
        """Open a session with the credentials of who the node speaks for.

        `keep` receives what belongs in the recording, and the wall time in ns.
        """
        self._node = node
        self._keep = keep
        self._queue: SimpleQueue[tuple[zenoh.Sample, int]] = SimpleQueue()
        self._queued_bytes = 0
        self._lock = threading.Lock()
        self.dropped = 0
        """How many messages came while too many waited."""
        self._subscribers: dict[str, zenoh.Subscriber[None]] = {}
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._due: float | None = None
        self._before_tick: int | None = None
        self._received: tuple[bytes, int] = b"", 0
        self.ended = False
        self._session = open_client(endpoint, None, credentials=credentials)

    def __enter__(self) -> Self:
        """Return the shell."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the session."""
        self.close()

    def close(self) -> None:
        """Undeclare everything, and close the session."""
        with contextlib.suppress(zenoh.ZError):  # the router may be gone
            for subscriber in self._subscribers.values():
                subscriber.undeclare()
            for declared in self._publishers.values():
                declared.undeclare()
        self._subscribers.clear()
        self._publishers.clear()
        self._session.close()

    @property
    def waiting(self) -> int:
        """Return how many messages wait for the node."""
        return self._queue.qsize()

    @property
    def connected(self) -> bool:
        """Return whether the session has its router at the moment."""
        return bool(routers_of(self._session))

    def start(self) -> None:
        """Start the node."""
        self.carry_out(self._node.start())

    def step(self, timeout_s: float | None = None) -> bool:
        """Take the next messages or tick, waiting at most so long; return whether any came.

        A tick comes after the messages that had arrived when it was due, and before all others.
        """
        if self._is_due():
            return self._tick()
        left = None if self._due is None else max(0.0, self._due - time.monotonic())
        wait = min((each for each in (left, timeout_s) if each is not None), default=None)
        most = _BATCH_MAX if isinstance(self._node, BatchNode) else 1
        if self._before_tick is not None:
            most = min(most, self._before_tick)
        try:
            arrived = [self._queue.get(timeout=wait)]
        except Empty:
            return self._due is not None and time.monotonic() >= self._due and self._tick()
        with contextlib.suppress(Empty):
            while len(arrived) < most:
                arrived.append(self._queue.get_nowait())
        if self._before_tick is not None:
            self._before_tick -= len(arrived)
        messages = [(str(sample.key_expr), sample.payload.to_bytes()) for sample, _ in arrived]
        self._received = messages[0][1], arrived[0][1]
        with self._lock:
            self._queued_bytes -= sum(len(data) for _, data in messages)
        if isinstance(self._node, BatchNode):
            effects = self._node.receive_all(messages)
        else:
            effects = self._node.receive(*messages[0])
        self.carry_out(effects)
        return True

    def _is_due(self) -> bool:
        """Return whether the tick comes next."""
        if self._due is None or time.monotonic() < self._due:
            return False
        if self._before_tick is None:
            self._before_tick = self._queue.qsize()
        return self._before_tick <= 0

    def _tick(self) -> bool:
        self._set_timer(None)
        self.carry_out(self._node.tick())
        return True

    def _set_timer(self, seconds: float | None) -> None:
        self._due = None if seconds is None else time.monotonic() + seconds
        self._before_tick = None

    def carry_out(self, effects: list[Effect]) -> None:
        """Carry out effects in their order."""
        for effect in effects:
            match effect:
                case Put(key=key, data=data):
                    self._put(key, data)
                case Keep():
                    self._on_record(effect)
                case Timer(seconds=seconds):
                    self._set_timer(seconds)
                case Listen(keys=keys):
                    for key in keys:
                        self._subscribers[key] = subscribe(self._session, key, self._enqueue)
                case Ignore(keys=keys):
                    for key in keys:
                        self._subscribers.pop(key).undeclare()
                case End():
                    self.ended = True

    def _on_record(self, kept: Keep[Any]) -> None:
        if self._keep is not None:
            data, wall_ns = self._received
            self._keep(kept, wall_ns if kept.data is data else time.time_ns())

    def _put(self, key: str, data: bytes) -> None:
        found = self._publishers.pop(key, None)
        if found is None:
            if len(self._publishers) >= _PUBLISHERS_MAX:
                self._publishers.pop(next(iter(self._publishers))).undeclare()
            found = publisher(self._session, key)
        self._publishers[key] = found  # the one used last is undeclared last
        found.put(data)

    def _enqueue(self, sample: zenoh.Sample) -> None:
        size = len(sample.payload)
        with self._lock:
            full = self._queue.qsize() >= _QUEUE_MAX or self._queued_bytes + size > _QUEUE_BYTES_MAX
            if full:
                self.dropped += 1
                return
            self._queued_bytes += size
        self._queue.put((sample, time.time_ns()))


def run_node(node: Node, endpoint: str, credentials: Credentials) -> None:
    """Run a node on its own session until it ends."""
    with Shell(node, endpoint, credentials=credentials) as shell:
        shell.start()
        while not shell.ended:
            shell.step()
