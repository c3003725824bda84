"""The log of a network under test: all messages by key, in bounded memory."""

import math
import threading
import time
from collections import Counter, deque
from collections.abc import Collection, Sequence
from dataclasses import replace
from operator import itemgetter
from typing import Any

from cubepath.coordinator.testing.log import What, pattern_of
from cubepath.coordinator.testing.rules import Pattern
from cubepath.coordinator.testing.wire_messages import WHAT_MAX, WireMessage, aligned, short
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.formatting import counted, did_you_mean
from cubepath.protocol.core.options import known_name

__tracebackhide__ = True  # pytest shows no frames of this module
KEYS = ("key", "sender", "to", "where")
"""What of a `Pattern` messages have that are not of cubepath."""
KEPT_MAX, KEPT_BYTES_MAX = 5000, 1 << 25
"""The number of messages that are kept, and of their bytes."""
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
    """All messages that passed a network, in order, as `WireMessage`; the last ones are kept.

    You choose them by a key expression (`what`), and by ``sender`` and ``where``, as for `Pattern`.
    A message is there when it has left the link of its sender; with ``to`` it is one that was
    delivered to that process. So copies that the sender's link made count, and what it lost does
    not; with ``lost`` it is what was lost there. The report shows all of it.

    All are counted. Of more than 5000, or 32 MiB, it forgets the oldest on the keys that have most.
    """

    def __init__(self, processes: Collection[str]) -> None:
        """Begin it; `processes` are the names that may be given."""
        self.changed = threading.Condition()
        self._processes = processes
        self._kept: list[WireMessage] = []
        self._done: deque[tuple[float, str]] = deque(maxlen=_DONE_SHOWN)
        self._size = 0
        self._counts: Counter[WireMessage] = Counter()
        self._uncounted = 0
        self._began_s = time.time()

    def add(self, seen: WireMessage) -> None:
        """Note that a message has passed, or was lost."""
        alike = WireMessage(seen.key, b"", link=seen.link, down=seen.down, lost=seen.lost)
        with self.changed:
            self._kept.append(seen)
            self._size += _size(seen)
            if self._size > KEPT_MAX * KEPT_BYTES_MAX:
                self._forget()
            if alike in self._counts or len(self._counts) < KEYS_MAX:
                self._counts[alike] += 1
            else:
                self._uncounted += 1
            self.changed.notify_all()

    def _forget(self) -> None:
        """Keep the last messages, on each key about as much, until three quarters are taken."""
        after, ranks = Counter[object](), list[tuple[int, int, int]]()
        for place, seen in enumerate(reversed(self._kept)):
            way, size = _way(seen), _size(seen)
            after[way] += size
            ranks.append((after[way], place, size))
        self._size, kept = 0, list[int]()
        for _, place, size in sorted(ranks):
            if kept and self._size + size > KEPT_MAX * KEPT_BYTES_MAX * 3 // 4:
                break
            self._size += size
            kept.append(place)
        self._kept = [self._kept[~place] for place in sorted(kept, reverse=True)]

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
        return self._count(self.pattern(what, **pattern), lost=lost)

    def has(self, times: int, meant: Pattern) -> bool:
        """Return whether there were this many; CheckError as `count`, if those kept are fewer."""
        return self._count(meant, enough=times) >= times

    def _count(self, meant: Pattern, *, lost: bool = False, enough: float = math.inf) -> int:
        anyhow = replace(meant, where=None)
        with self.changed:
            counts = [
                n for one, n in self._counts.items() if one.lost == lost and anyhow.holds(one)
            ]
            kept = self.messages(anyhow, lost=lost) if meant.where else []
        found, gone = sum(counts), self._uncounted
        total = found + gone
        if meant.where:
            gone, found = total - len(kept), sum(map(bool, map(meant.where, kept)))
        if gone and found < enough:
            raise CheckError(
                f"{meant}: the log has forgotten {gone} of {total} such messages, expected fewer or"
                f" an earlier look: it keeps {KEPT_MAX}, or {KEPT_BYTES_MAX >> 20} MiB, and counts"
                f" {KEYS_MAX} keys"
            )
        return found

    def messages(self, what: What = "", *, lost: bool = False, **pattern: Any) -> list[WireMessage]:
        """Return such messages in order, or those `lost`, of those that are kept."""
        meant = self.pattern(what, **pattern)
        with self.changed:
            return [seen for seen in self._kept if seen.lost == lost and meant.holds(seen)]

    def assert_order(self, first: What, then: What) -> None:
        """Check that the first message of one key or pattern comes before the first of another.

        CheckError as `count`.
        """
        one, two = self.pattern(first), self.pattern(then)
        with self.changed:
            there = [*self._counts]  # in the order of the first of each
            if one.where or two.where:
                there = self._kept
                for each in (one, two):  # of which none is forgotten
                    self._count(replace(each, where=bool))
            there = [seen for seen in there if not seen.lost]
            order = [one.holds(seen) for seen in there if one.holds(seen) or two.holds(seen)]
        if all(order) or not order[0]:
            raise AssertionError(f"'{first}' does not come before '{then}'")

    def near(self, meant: Pattern) -> str:
        """Return a hint at the nearest key if nothing was ever put on the one that is meant."""
        key = meant.key
        if key is None or self.count(key) or self.count(key, lost=True):
            return ""
        return did_you_mean(key, {alike.key for alike in [*self._counts]})

    def __str__(self) -> str:
        """Return how many messages there were on each key, which were lost, and the last."""
        passed, lost = Counter[str](), Counter[str]()
        with self.changed:
            for alike, count in self._counts.items():
                passed[alike.key] += 0 if alike.down or alike.lost else count
                lost[alike.key] += count if alike.lost and not alike.down else 0
            shown = _shown(self._kept)
            found = [(at_s, ("", "", "", done, "")) for at_s, done in self._done]
        keys = sorted(passed, key=lambda key: (not lost[key], -passed[key]))[:_KEYS_SHOWN]
        often = [(f"  {passed[k]:6}", f"({lost[k]} lost)" if lost[k] else "", k) for k in keys]
        for seen, times, last_s in shown:
            mark = "lost" if seen.lost else "copy" if seen.copied else ""
            data = "deleted" if seen.deletes else _text_of(seen.data)
            if times > 1:
                data += f" ({times} times, until {last_s - self._began_s:.3f})"
            found.append((seen.at_s, (mark, seen.sender, seen.to, seen.key, data)))
        rows = [("  ", "s", "from", "to", "key", "data")]
        for at_s, (mark, one, other, key, data) in sorted(found, key=itemgetter(0)):
            rows.append((f"  {mark}", f"{at_s - self._began_s:.3f}", one, other, key, data))
        lines = [f"messages by key, {counted(len(passed), 'key')}:"]
        lines += aligned(often) if often else []
        lines += ["the last messages on each key:", *aligned(rows)]
        return "\n".join(line.rstrip() for line in lines)


def _way(seen: WireMessage) -> tuple[object, ...]:
    return seen.key, seen.link, seen.down, seen.lost


def _size(seen: WireMessage) -> int:
    """Return how much of the log a message takes: its share of the messages and of the bytes."""
    return KEPT_BYTES_MAX + KEPT_MAX * (len(seen.data) + len(seen.attachment or b""))


def _shown(kept: Sequence[WireMessage]) -> list[tuple[WireMessage, int, float]]:
    """Return which messages the report shows, how often each came in a row, and when it last did.

    They are those that were lost, and as many of the last on each key and way.
    """
    ways: dict[object, list[tuple[int, int, float]]] = {}
    for place, seen in enumerate(kept):
        way, first, times = ways.setdefault(_way(seen), []), place, 0
        if way and replace(kept[way[-1][0]], at_s=seen.at_s) == seen:
            first, times, _ = way.pop()
        way.append((first, times + 1, seen.at_s))
    share = max(1, _ROWS // max(1, len(ways)))
    places = list[tuple[int, int, float]]()
    for way in ways.values():
        places += way[-(_ROWS if kept[way[0][0]].lost else share) :]
    rows = sorted(places)[-2 * _ROWS :]
    return [(kept[place], times, last_s) for place, times, last_s in rows]


def _text_of(data: bytes) -> str:
    """Return the beginning of a message as text, or in hexadecimal digits."""
    text = data[: 4 * WHAT_MAX].decode(errors="replace")
    return short(text if text.isprintable() else data[:WHAT_MAX].hex(), WHAT_MAX)
