"""The log times of messages that were heard, and which of them came before.

Log times are those of the run's own recording: the round, the greatest level so far, or the wall
clock.
"""

from __future__ import annotations

from hashlib import blake2b

from cubepath.coordinator.runs.about import About
from cubepath.coordinator.tools.attached.backlog import Heard
from cubepath.coordinator.tools.attached.losses import Head
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.recordings.description import FREE_FORMAT
from cubepath.protocol.wire.free_messages import decode_free, level_of

_REMEMBERED = 1 << 15
_NUMBERS_MAX = (1 << 53) - 1


class Times:
    """Tells log times; one that cannot be read is that of the message before."""

    def __init__(self, about: About) -> None:
        """Begin before the first message."""
        self._free = about.format == FREE_FORMAT
        self._by_wall = about.parameters.get("log_time") == "wall"
        self._now = about.round if self._free else 0
        self._seen: set[bytes] = set()
        self._seen_before: set[bytes] = set()

    def of(self, kind: str, heard: Heard, head: Head | None) -> tuple[int, int, bool]:
        """Return the log time, the first whole round from here on, and whether a round begins."""
        if self._free:
            if kind in ("moved", "tail"):
                self._now = max(self._now, _level(heard.data))
            return (heard.wall_ns if self._by_wall else self._now), self._now + 1, False
        if head is not None and 0 <= head.round <= _NUMBERS_MAX:
            self._now = head.round
        phase = None if head is None else head.phase
        first = kind == "go" and phase == "sense"
        joins = self._now == 0
        return self._now, self._now if first else 1 if joins else self._now + 1, first

    def is_repeated(self, topic: str, data: bytes) -> bool:
        """Return whether a process or a keeper has said just this before.

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
