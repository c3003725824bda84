"""The messages of a recording by position: the one at a mark, the next, the first of a round.

It also reads positions and speeds as users write them: "12", "3.5s"; "10", "2x", "max".

Files are read one chunk at a time, and the last few chunks are kept. A position is found without
reading what lies before it: a round by the log times of chunks, a time by bisection, since the
clock of a run only goes forward.
"""

from __future__ import annotations

import math
import re
from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import msgspec

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.recordings.stored_messages import Record

_SECONDS = re.compile(r"(\d+(?:\.\d*)?|\.\d+)s", re.ASCII)
_WHOLE = re.compile(r"\d{1,15}", re.ASCII)
_RATE = re.compile(r"(\d+(?:\.\d*)?(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?)(x?)", re.ASCII)
RATE_MIN = 1e-5
"""About a round a day."""
_EXPECTED_SPOT = "expected a round or level such as 12, or a time such as 3.5s"
_EXPECTED_RATE = (
    f"expected rounds or levels a second such as 10, times as fast as it was such as 2x, both at"
    f" least {RATE_MIN:f}".rstrip("0")
    + ", or max"
)


@dataclass(frozen=True, slots=True)
class TimelinePosition:
    """A place in a recording: a round or level, or seconds since its first message.

    >>> read_spot("12"), read_spot("3.5s").seconds
    (TimelinePosition(step=12, seconds=None), 3.5)
    """

    step: int | None = None
    seconds: float | None = None

    def __str__(self) -> str:
        """Return the text that it is read from."""
        return str(self.step) if self.seconds is None else f"{self.seconds:g}s"

    def comes_after(self, other: TimelinePosition) -> bool:
        """Return whether it is later than another of its sort; one of another sort is not."""
        if self.seconds is None:
            return other.step is not None and (self.step or 0) > other.step
        return other.seconds is not None and self.seconds > other.seconds


def read_spot(text: str | int, name: str = "to") -> TimelinePosition:
    """Return the place that is written as "12" or "3.5s"; InputError if it is none."""
    written = str(text)
    if _WHOLE.fullmatch(written) and not isinstance(text, bool):
        return TimelinePosition(step=int(written))
    found = _SECONDS.fullmatch(written)
    if found is None:
        raise InputError(f"{name}={written}: {_EXPECTED_SPOT}")
    return TimelinePosition(seconds=float(found[1]))


@dataclass(frozen=True, slots=True)
class PlaybackRate:
    """How fast messages follow one another; without a rate as fast as possible.

    By "step" the rate is in rounds or levels a second, by "clock" it is how many times as fast as
    it was, by the publish times.
    """

    rate: float | None = None
    by: Literal["step", "clock"] = "step"

    def __str__(self) -> str:
        """Return the text that it is read from."""
        return "max" if self.rate is None else f"{self.rate:g}{'x' if self.by == 'clock' else ''}"

    def times(self, factor: float) -> PlaybackRate:
        """Return a pace this many times as fast; nothing is faster than as fast as possible."""
        if self.rate is None:
            return self
        return PlaybackRate(max(self.rate * factor, RATE_MIN), self.by)


def read_pace(text: str, *, by_wall: bool = False) -> PlaybackRate:
    """Return the pace that is written as "10", "2x" or "max"; InputError if it is none.

    Where log time is the wall clock (`by_wall`), there are no rounds to count, and "2" is "2x".
    """
    if text == "max":
        return PlaybackRate()
    found = _RATE.fullmatch(text)
    rate = float(found[1]) if found else math.nan
    if found is None or not RATE_MIN <= rate < math.inf:
        raise InputError(f"rate={text}: {_EXPECTED_RATE}")
    return PlaybackRate(rate, "clock" if found[2] or by_wall else "step")


_KEPT = 3
"""Chunks in memory: where it plays, the one before, and one that was just looked at."""


class Cursor(NamedTuple):
    """A place between two messages: before a message of a chunk; the end has its own chunk."""

    chunk: int
    place: int


START = Cursor(0, 0)


class _Numbered(msgspec.Struct):
    round: int = 0
    level: int = 0


_numbers_in = msgspec.json.Decoder(_Numbered).decode


class Timeline:
    """The messages of a recording in the order of writing, whether it is a file or in memory."""

    def __init__(self, recording: Recording) -> None:
        self.recording = recording
        self.by_wall = recording.parameters.get("log_time") == "wall"
        """Whether log time is the wall clock, so that rounds or levels stand in messages alone."""
        self._chunks = recording.chunks()
        self._kept: OrderedDict[int, Sequence[Record]] = OrderedDict()
        self._free = recording.clock == "free"
        self.end = Cursor(len(self._chunks), 0)

    def chunk(self, number: int) -> Sequence[Record]:
        """Return the messages of a chunk."""
        found = self._kept.get(number)
        if found is None:
            found = self._kept[number] = self._chunks[number].read()
            while len(self._kept) > _KEPT:
                self._kept.popitem(last=False)
        else:
            self._kept.move_to_end(number)
        return found

    def settled(self, mark: Cursor) -> Cursor:
        """Return the mark of the next message that there is, at or after a mark; or the end."""
        chunk, place = mark
        while chunk < self.end.chunk and place >= len(self.chunk(chunk)):
            chunk, place = chunk + 1, 0
        return Cursor(chunk, place)

    def next(
        self, mark: Cursor, kinds: frozenset[str] | None = None
    ) -> tuple[Cursor, Record] | None:
        """Return the first message at or after a mark, and where it stands; None at the end.

        Chunks without any of the kinds are not read; other kinds may come all the same.
        """
        chunk, place = mark
        while chunk < self.end.chunk:
            if self._may_hold(chunk, kinds):
                records = self.chunk(chunk)
                if place < len(records):
                    return Cursor(chunk, place), records[place]
            chunk, place = chunk + 1, 0
        return None

    def backward(
        self, mark: Cursor, kinds: frozenset[str] | None = None
    ) -> Iterator[tuple[Cursor, Record]]:
        """Yield the messages before a mark, the last one first; chunks as for `next`."""
        chunk, place = mark
        while True:
            records = self.chunk(chunk) if place else ()
            while place > 0:
                place -= 1
                yield Cursor(chunk, place), records[place]
            if chunk == 0:
                return
            chunk -= 1
            if self._may_hold(chunk, kinds):
                place = len(self.chunk(chunk))

    def _may_hold(self, chunk: int, kinds: frozenset[str] | None) -> bool:
        held = self._chunks[chunk].kinds
        return kinds is None or "" in held or not kinds.isdisjoint(held)

    def last_round_before(self, chunk: int) -> int:
        """Return the greatest log time of all chunks before one."""
        return self._greatest[chunk]

    @cached_property
    def _greatest(self) -> list[int]:
        found = [-1]
        for chunk in self._chunks:
            found.append(max(found[-1], chunk.last_round))
        return found

    # Times: seconds since the first message.

    @cached_property
    def began_ns(self) -> int:
        """The publish time of the first message."""
        found = self.next(START)
        return 0 if found is None else self.recording.received_ns(found[1])

    @cached_property
    def seconds(self) -> float:
        """The publish time of the last message."""
        last = next(self.backward(self.end), None)
        return 0.0 if last is None else self.time_of(last[1])

    def time_of(self, record: Record) -> float:
        """Return when a message was published, in seconds since the first one."""
        return (self.recording.received_ns(record) - self.began_ns) / 1e9

    def time_at(self, mark: Cursor) -> float:
        """Return when the message at a mark was published; at the end when the last one was."""
        found = self.next(mark)
        return self.seconds if found is None else self.time_of(found[1])

    # Steps: rounds or levels.

    def step_at(self, mark: Cursor) -> int:
        """Return the round or level of the message at a mark; at the end that of the last one."""
        if self.by_wall:
            place = bisect_right(self._rises, (self.settled(mark), 0x7FFFFFFFFFFFFFFF))
            return self._rises[place - 1][1] if place else 0
        found = self.next(mark) or next(self.backward(mark), None)
        return 0 if found is None else found[1].round

    @cached_property
    def _rises(self) -> list[tuple[Cursor, int]]:
        """Where the round or level rises, where log time does not tell: all is read for it."""
        found: list[tuple[Cursor, int]] = []
        last = 0
        each = self.next(START)
        while each is not None:
            mark, record = each
            value = self._number_in(record)
            if value > last:
                found.append((mark, value))
                last = value
            each = self.next(Cursor(mark.chunk, mark.place + 1))
        return found

    def _number_in(self, record: Record) -> int:
        if self._free and record.kind != "commit":
            return 0
        try:
            found = _numbers_in(record.data)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            return 0  # playing it reports what is wrong
        return found.level if self._free else found.round

    # Places.

    def find(self, spot: TimelinePosition, *, after: bool = False) -> Cursor:
        """Return where a round, level or time begins, or (`after`) where the next one does.

        A round begins before the first message of it or a later one, a time before the first
        message that was published then or later. The end, if there is no such message.
        """
        if spot.seconds is not None:
            return self._at_time(spot.seconds, after=after)
        least = (spot.step or 0) + after
        if self.by_wall:
            if least <= 0:
                return self.settled(START)
            return next((mark for mark, step in self._rises if step >= least), self.end)
        for number, chunk in enumerate(self._chunks):
            if chunk.last_round >= least:
                for place, record in enumerate(self.chunk(number)):
                    if record.round >= least:
                        return Cursor(number, place)
        return self.end

    def _at_time(self, seconds: float, *, after: bool) -> Cursor:
        def comes_before(record: Record) -> bool:
            time = self.time_of(record)
            return time <= seconds if after else time < seconds

        low, high = 0, self.end.chunk
        while low < high:  # the chunks before `low` end before that time
            middle = (low + high) // 2
            records = self.chunk(middle)
            if not records or comes_before(records[-1]):
                low = middle + 1
            else:
                high = middle
        if low == self.end.chunk:
            return self.end
        first, last = 0, len(self.chunk(low))
        while first < last:
            middle = (first + last) // 2
            if comes_before(self.chunk(low)[middle]):
                first = middle + 1
            else:
                last = middle
        return self.settled(Cursor(low, first))
