"""The last seconds of what was heard, bounded: the oldest go first.

It touches no file and no network.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from cubepath.coordinator.tools.attached.backlog import OVERHEAD_BYTES


class Kept(NamedTuple):
    """A message as it will stand in a recording."""

    topic: str
    data: bytes
    at: int
    wall_ns: int
    begins: int
    """The first whole round of a recording that begins with it."""


class Window:
    """What came in the last seconds, and takes no more than so many bytes."""

    def __init__(self, seconds: float, bytes_max: int) -> None:
        """Begin empty."""
        self._span_ns = int(seconds * 1e9)
        self._most = bytes_max
        self._kept: deque[Kept] = deque()
        self._bytes = 0
        self.dropped = 0
        """How many went before their time, for want of memory."""

    def put(self, kept: Kept) -> None:
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

    def at(self, now_ns: int) -> tuple[Kept, ...]:
        """Return what came in the last seconds before a wall time, in nanoseconds."""
        self._let_go(now_ns)
        return tuple(self._kept)
