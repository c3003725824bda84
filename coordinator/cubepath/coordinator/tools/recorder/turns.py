"""Messages heard of a run with rounds, in an order in which the coordinator can have heard them.

A router keeps the order of each sender, but not the order between senders: the answer of a process
may arrive after the coordinator's next message, or before the question. Then one waits for the
other, for a short while. This module uses no network.

It also gives messages their log times, which are those of the run's own recording: the round, the
greatest level so far, or the wall clock.
"""

import time
from collections import deque
from collections.abc import Callable, Iterator
from hashlib import blake2b
from typing import NamedTuple, TypeAlias

from cubepath.coordinator.runs.asking import RunInfo
from cubepath.coordinator.tools.recorder.backlog import ReceivedMessage
from cubepath.coordinator.tools.recorder.losses import Head
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.recordings.description import FREE_FORMAT
from cubepath.protocol.wire.free_messages import decode_free, level_of

_REMEMBERED = 1 << 15
_NUMBERS_MAX = (1 << 53) - 1


class MessageTimes:
    """Tells log times; one that cannot be read is that of the message before."""

    def __init__(self, about: RunInfo) -> None:
        self._free = about.format == FREE_FORMAT
        self._by_wall = about.parameters.get("log_time") == "wall"
        self._now = about.round if self._free else 0
        self._seen: set[bytes] = set()
        self._seen_before: set[bytes] = set()

    def of(self, kind: str, heard: ReceivedMessage, head: Head | None) -> tuple[int, int, bool]:
        """Return the log time, the first whole round from here on, and whether a round begins."""
        if self._free:
            if kind in ("commit", "commits"):
                self._now = max(self._now, _level(heard.data))
            return (heard.wall_ns if self._by_wall else self._now), self._now + 1, False
        if head is not None and 0 <= head.round <= _NUMBERS_MAX:
            self._now = head.round
        phase = None if head is None else head.phase
        first = kind == "go" and phase == "sense"
        joins = self._now == 0
        return self._now, self._now if first else 1 if joins else self._now + 1, first

    def is_repeated(self, topic: str, data: bytes) -> bool:
        """Return whether a process or a keeper has sent exactly this before.

        It does so when others have missed it; the run's own recording has it once.
        """
        if topic.endswith("/coordinator"):
            return False
        seen = blake2b(data, digest_size=16, key=topic.encode()[:64]).digest()
        if seen in self._seen or seen in self._seen_before:
            return True
        self._seen.add(seen)
        if len(self._seen) >= _REMEMBERED:
            self._seen_before, self._seen = self._seen, set()
        return False


def _level(data: bytes) -> int:
    try:
        return level_of(decode_free(data))
    except InputError:
        return 0


_HELD_S = 1.0
"""How long a message waits at most: what it waits for may be lost."""
_HELD_MAX = 1 << 14
_RANKS = {"join": 0, "sense": 1, "observe": 2, "claim": 3, "settle": 4, "over": 5}
_TOLD_IN = {
    "reports": "settle",
    "observations": "observe",
    "retransmit": "sense",
    "waiting": "sense",
}
"""Messages that name no phase, or none that counts, with the first in which they can come."""
Stage: TypeAlias = tuple[int, int]
"""A round and the rank of a phase in it."""
_JOIN: Stage = (0, 0)


class OrderedMessage(NamedTuple):
    """A message on its way to the recording."""

    topic: str
    heard: ReceivedMessage
    head: Head | None
    wanted: bool


class MessageOrder:
    """Puts messages in order: answers after what they answer, and the next `go` after them."""

    def __init__(
        self,
        processes: int | None,
        *,
        from_start: bool,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Begin before the first `go` of a run of this many processes, or anywhere in a run.

        In the middle of a run messages pass as they come until a phase begins. Those of a run
        without rounds (None) tell by versions what they follow from, and pass.
        """
        self._paced = processes is not None
        self._processes = max(1, processes or 0)
        self._clock = clock
        self._now: Stage | None = _JOIN if from_start and self._paced else None
        self._ready: set[int] = set()
        self._reported: set[int] = set()
        """The processes that have answered, and that have reported, in this phase."""
        self._orders: deque[tuple[int, OrderedMessage]] = deque()
        """What the coordinator says, in its order."""
        self._early: list[tuple[int, OrderedMessage]] = []
        """What processes have answered before it was heard that they were asked."""
        self._count = 0
        self._since: float | None = None

    def put(self, item: OrderedMessage) -> Iterator[OrderedMessage]:
        """Yield what may be written now that this has come."""
        kind, _, sender = item.topic.partition("/")
        self._count += 1
        if self._now is None:
            if kind == "go" and self._paced:
                self._begin(item)
            yield item
            return
        if sender == "coordinator":
            self._orders.append((self._count, item))
        else:
            stage = _stage(kind, item.head)
            if stage is not None and stage > self._now:
                self._early.append((self._count, item))
            else:
                self._note(kind, stage, item)
                yield item
        if self._orders:
            yield from self._go_on()
        if not (self._orders or self._early):
            self._since = None
        elif self._since is None:
            self._since = self._clock()
        elif len(self._early) + len(self._orders) > _HELD_MAX:
            yield from self.rest()

    def due(self) -> Iterator[OrderedMessage]:
        """Yield what has waited too long, as it came."""
        if self._since is not None and self._clock() - self._since > _HELD_S:
            yield from self.rest()

    def rest(self) -> Iterator[OrderedMessage]:
        """Yield all that waits, as it came; then all passes until a phase begins."""
        held = sorted([*self._orders, *self._early], key=lambda each: each[0])
        self._orders.clear()
        self._early, self._since, self._now = [], None, None
        for _, item in held:
            if item.topic.startswith("go/"):
                self._begin(item)
        for _, item in held:  # what was answered in the phase that was begun last counts
            kind = item.topic.partition("/")[0]
            self._note(kind, _stage(kind, item.head), item)
            yield item

    def _go_on(self) -> Iterator[OrderedMessage]:
        """Yield what the coordinator says, as far as it was answered what that follows from."""
        while self._orders and self._may_come(self._orders[0][1]):
            item = self._orders.popleft()[1]
            yield item
            if item.topic.startswith(("go/", "reset/")):
                self._begin(item)
                early, self._early = self._early, []
                for number, each in early:
                    kind = each.topic.partition("/")[0]
                    stage = _stage(kind, each.head)
                    if stage is not None and self._now is not None and stage > self._now:
                        self._early.append((number, each))
                    else:
                        self._note(kind, stage, each)
                        yield each

    def _may_come(self, item: OrderedMessage) -> bool:
        kind, now = item.topic.partition("/")[0], self._now
        if now is None or len(self._ready) >= self._processes:
            return True
        if now == _JOIN and not self._ready:  # they had joined before anyone listened
            return True
        if kind == "go":
            stage = _stage(kind, item.head)
            return stage is None or stage <= now
        # The moves of a round are known when all have reported it.
        settle = item.head is not None and (item.head.round, _RANKS["settle"]) >= now
        return kind != "edges" or not settle or len(self._reported) >= self._processes

    def _begin(self, item: OrderedMessage) -> None:
        stage = _JOIN if item.topic.startswith("reset/") else _stage("go", item.head)
        if stage is not None and stage != self._now:
            self._now, self._ready, self._reported = stage, set(), set()

    def _note(self, kind: str, stage: Stage | None, item: OrderedMessage) -> None:
        if stage == self._now and item.head is not None:
            if kind == "ready":
                self._ready.add(item.head.process)
            elif kind == "reports":
                self._reported.add(item.head.process)


def _stage(kind: str, head: Head | None) -> Stage | None:
    """Return the phase of a message; None if it belongs to none."""
    if head is None:
        return None
    rank = _RANKS.get(_TOLD_IN.get(kind) or head.phase or "")
    return None if rank is None else (head.round, rank)
