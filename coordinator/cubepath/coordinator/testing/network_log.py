"""The log of a network under test: all messages by key, in bounded memory."""

import threading
import time
from collections import Counter, deque
from collections.abc import Collection
from dataclasses import replace
from operator import itemgetter
from typing import Any

from cubepath.coordinator.testing.log import What, pattern_of
from cubepath.coordinator.testing.rules import Pattern
from cubepath.coordinator.testing.wire_messages import WHAT_MAX, WireMessage, aligned, short
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.formatting import did_you_mean
from cubepath.protocol.core.options import known_name

__tracebackhide__ = True  # pytest shows no frames of this module
KEYS = ("key", "sender", "to", "where")
"""What of a `Pattern` messages have that are not of cubepath."""
KEPT_MAX, KEPT_BYTES_MAX = 5000, 1 << 25
"""The number of last messages that are kept, and of their bytes."""
KEYS_MAX = 100_000
"""The number of keys whose messages are counted, those of each sender and receiver."""
_ROWS, _KEYS_SHOWN, _DONE_SHOWN = 40, 20, 20


def known_process(name: object, known: Collection[str]) -> str:
    """Return the name of a process that is there; InputError says how it comes to be."""
    if isinstance(name, str) and name in known:
        return name
    near = did_you_mean(name, known) if isinstance(name, str) else ""
    there = f"one of {', '.join(sorted(known))}, or " if known else ""
    raise InputError(
        f"{name}: not started yet{near}, expected {there}network.start({name!r}, ...) or"
        f" network.endpoint({name!r}) before"
    )


class MessageLog:
    """All messages that passed a network, in order, as `WireMessage`; the last 5000 are kept.

    You choose them by a key expression (`what`), and by ``sender`` and ``where``, as for `Pattern`.
    A message is there when it has left the link of its sender; with ``to`` it is one that was
    delivered to that process. So copies that the sender's link made count, and what it lost does
    not; with ``lost`` it is what was lost there. The report shows all of it.
    """

    def __init__(self, processes: Collection[str]) -> None:
        """Begin it; `processes` are the names that may be given."""
        self.changed = threading.Condition()
        self._processes = processes
        self._kept: deque[WireMessage] = deque()
        self._done: deque[tuple[float, str]] = deque(maxlen=_DONE_SHOWN)
        self._bytes = 0
        self._counts: Counter[WireMessage] = Counter()
        self._uncounted = 0
        self._began_s = time.time()

    def add(self, seen: WireMessage) -> None:
        """Note that a message has passed, or was lost."""
        alike = WireMessage(seen.key, b"", link=seen.link, down=seen.down, lost=seen.lost)
        with self.changed:
            self._kept.append(seen)
            self._bytes += len(seen.data) + len(seen.attachment or b"")
            while len(self._kept) > KEPT_MAX or self._bytes > KEPT_BYTES_MAX:
                old = self._kept.popleft()
                self._bytes -= len(old.data) + len(old.attachment or b"")
            if alike in self._counts or len(self._counts) < KEYS_MAX:
                self._counts[alike] += 1
            else:
                self._uncounted += 1
            self.changed.notify_all()

    def note(self, done: str) -> None:
        """Note what was done to a process, for the report."""
        with self.changed:
            self._done.append((time.time(), done))

    def pattern(self, what: What = "", **given: Any) -> Pattern:
        """Return what is meant; InputError for what only messages of cubepath have."""
        by_key = {"key": what} if isinstance(what, str) and what else {}
        for name in given:
            known_name("", name, KEYS)
        found = pattern_of("" if by_key else what, **by_key, **given)
        for name in Pattern.__slots__:
            if getattr(found, name) is not None:
                known_name("", name, KEYS)
        if None not in (found.sender, found.to):
            raise InputError("sender and to: a receiver does not know the sender, expected one")
        for process in {found.sender, found.to} - {None}:
            known_process(process, self._processes)
        return found

    def count(self, what: What = "", *, lost: bool = False, **pattern: Any) -> int:
        """Return how many such messages there were, or were `lost`.

        CheckError if it takes a look (``where``) at messages that are kept no more.
        """
        meant = self.pattern(what, **pattern)
        anyhow = replace(meant, where=None)
        with self.changed:
            counts = [(alike, count) for alike, count in self._counts.items() if alike.lost == lost]
            total = sum(count for alike, count in counts if anyhow.holds(alike))
            there = self.messages(anyhow, lost=lost) if meant.where is not None else []
        if self._uncounted or (meant.where is not None and len(there) < total):
            raise CheckError(
                f"{meant}: kept are {len(there)} of {total} messages and {len(self._counts)} keys,"
                f" {self._uncounted} are not counted"
            )
        return total if meant.where is None else sum(map(bool, map(meant.where, there)))

    def messages(self, what: What = "", *, lost: bool = False, **pattern: Any) -> list[WireMessage]:
        """Return such messages in order, or those `lost`, of those that are kept."""
        meant = self.pattern(what, **pattern)
        with self.changed:
            return [seen for seen in self._kept if seen.lost == lost and meant.holds(seen)]

    def assert_order(self, first: What, then: What) -> None:
        """Check that the first message of one key or pattern comes before the first of another."""
        one, two = self.pattern(first), self.pattern(then)
        there = [seen for seen in [*self._kept] if not seen.lost]
        order = [one.holds(seen) for seen in there if one.holds(seen) or two.holds(seen)]
        if all(order) or not order[0]:
            raise AssertionError(f"'{first}' does not come before '{then}'")

    def __str__(self) -> str:
        """Return how many messages there were on each key, and the last, with what was done."""
        with self.changed:
            last, counts = [*self._kept][-_ROWS:], Counter[str]()
            for alike, count in self._counts.items():
                counts[alike.key] += 0 if alike.down or alike.lost else count
            found = [(at_s, ("", "", "", done, "")) for at_s, done in self._done]
        most = [f"  {count:6} {key}" for key, count in counts.most_common(_KEYS_SHOWN)]
        for seen in last:
            mark = "lost" if seen.lost else "copy" if seen.copied else ""
            data = "deleted" if seen.deletes else _text_of(seen.data)
            found.append((seen.at_s, (mark, seen.sender, seen.to, seen.key, data)))
        rows = [("", "s", "from", "to", "key", "data")]
        for at_s, (mark, one, other, key, data) in sorted(found, key=itemgetter(0)):
            rows.append((mark, f"{at_s - self._began_s:.3f}", one, other, key, data))
        return "\n".join(
            [f"messages by key, {len(counts)} keys:", *most, "the last messages:"]
            + ["  " + line.rstrip() for line in aligned(rows)]
        )


def _text_of(data: bytes) -> str:
    """Return the beginning of a message as text, or in hexadecimal digits."""
    text = data[: 4 * WHAT_MAX].decode(errors="replace")
    return short(text if text.isprintable() else data[:WHAT_MAX].hex(), WHAT_MAX)
