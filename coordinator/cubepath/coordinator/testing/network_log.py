"""The log of a network under test: all messages by key, in bounded memory."""

import threading
import time
from collections import Counter, deque
from collections.abc import Collection
from dataclasses import replace
from typing import Any

from cubepath.coordinator.testing.log import What, pattern_of
from cubepath.coordinator.testing.rules import Pattern
from cubepath.coordinator.testing.wire_messages import WHAT_MAX, WireMessage, aligned, short
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.options import known_name

__tracebackhide__ = True  # pytest shows no frames of this module
KEYS = ("key", "sender", "to", "where")
"""What of a `Pattern` messages have that are not of cubepath."""
KEPT_MAX, KEPT_BYTES_MAX = 5000, 1 << 25
"""The number of last messages that are kept, and of their bytes."""
KEYS_MAX = 100_000
"""The number of keys whose messages are counted, those of each sender and receiver."""
_ROWS, _KEYS_SHOWN = 40, 20


class MessageLog:
    """All messages that passed a network, in order, as `WireMessage`; the last 5000 are kept.

    You choose them by a key expression (`what`), and by ``sender`` and ``where``, as for `Pattern`.
    A message is there when it has left the link of its sender; with ``to`` it is one that was
    delivered to that process. What was lost on the way is shown, and not counted.
    """

    def __init__(self, processes: Collection[str]) -> None:
        """Begin it; `processes` are the names that may be given."""
        self.changed = threading.Condition()
        self._processes = processes
        self._kept: deque[tuple[WireMessage, bool]] = deque()
        self._bytes = 0
        self._counts: Counter[WireMessage] = Counter()
        self._uncounted = 0
        self._began_s = time.time()

    def add(self, seen: WireMessage, lost: bool) -> None:  # noqa: FBT001 - as a link tells it
        """Note that a message has passed, or was lost."""
        alike = WireMessage(seen.key, b"", link=seen.link, down=seen.down)
        with self.changed:
            self._kept.append((seen, lost))
            self._bytes += len(seen.data) + len(seen.attachment or b"")
            while len(self._kept) > KEPT_MAX or self._bytes > KEPT_BYTES_MAX:
                old, _ = self._kept.popleft()
                self._bytes -= len(old.data) + len(old.attachment or b"")
            if alike in self._counts or len(self._counts) < KEYS_MAX:
                self._counts[alike] += not lost
            else:
                self._uncounted += 1
            self.changed.notify_all()

    def pattern(self, what: What = "", **given: Any) -> Pattern:
        """Return what is meant; InputError for what only messages of cubepath have."""
        by_key = {"key": what} if isinstance(what, str) and what else {}
        found = pattern_of("" if by_key else what, **by_key, **given)
        for name in Pattern.__slots__:
            if getattr(found, name) is not None:
                known_name("", name, KEYS)
        if None not in (found.sender, found.to):
            raise InputError("sender and to: a receiver does not know the sender, expected one")
        for process in {found.sender, found.to} - {None}:
            known_name("", process, sorted(self._processes))
        return found

    def count(self, what: What = "", **pattern: Any) -> int:
        """Return how many such messages there were.

        CheckError if it takes a look (``where``) at messages that are kept no more.
        """
        meant = self.pattern(what, **pattern)
        anyhow = replace(meant, where=None)
        with self.changed:
            total = sum(count for alike, count in self._counts.items() if anyhow.holds(alike))
            there = self.messages(anyhow) if meant.where is not None else []
        if self._uncounted or (meant.where is not None and len(there) < total):
            raise CheckError(
                f"{meant}: kept are {len(there)} of {total} messages and {len(self._counts)} keys,"
                f" {self._uncounted} are not counted"
            )
        return total if meant.where is None else sum(map(bool, map(meant.where, there)))

    def messages(self, what: What = "", **pattern: Any) -> list[WireMessage]:
        """Return such messages in order, of those that are kept."""
        meant = self.pattern(what, **pattern)
        with self.changed:
            return [seen for seen, lost in self._kept if not lost and meant.holds(seen)]

    def assert_order(self, first: What, then: What) -> None:
        """Check that the first message of one key or pattern comes before the first of another."""
        one, two = self.pattern(first), self.pattern(then)
        there = [seen for seen, lost in [*self._kept] if not lost]
        order = [one.holds(seen) for seen in there if one.holds(seen) or two.holds(seen)]
        if all(order) or not order[0]:
            raise AssertionError(f"'{first}' does not come before '{then}'")

    def __str__(self) -> str:
        """Return how many messages there were on each key, and the last of them."""
        with self.changed:
            last, counts = [*self._kept][-_ROWS:], Counter[str]()
            for alike, count in self._counts.items():
                counts[alike.key] += 0 if alike.down else count
        most = [f"  {count:6} {key}" for key, count in counts.most_common(_KEYS_SHOWN)]
        rows = [("", "s", "from", "to", "key", "data")]
        for seen, lost in last:
            data = "deleted" if seen.deletes else _text_of(seen.data)
            at = f"{seen.at_s - self._began_s:.3f}"
            rows.append(("lost" if lost else "", at, seen.sender, seen.to, seen.key, data))
        return "\n".join(
            [f"messages by key, {len(counts)} keys:", *most, "the last messages:"]
            + ["  " + line.rstrip() for line in aligned(rows)]
        )


def _text_of(data: bytes) -> str:
    """Return the beginning of a message as text, or in hexadecimal digits."""
    text = data[: 4 * WHAT_MAX].decode(errors="replace")
    return short(text if text.isprintable() else data[:WHAT_MAX].hex(), WHAT_MAX)
