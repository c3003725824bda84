"""The messages of a recording by their place: the one at a mark, the next, the first of a round.

It reads files a chunk at a time, and keeps the last few chunks. Places are found without reading
what lies before them: a round by the log times of chunks, a time by halving, as the clock of a run
goes forward.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import NamedTuple

import msgspec

from cubepath.coordinator.playback.spots import Spot
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.recordings.records import Record

_KEPT = 3
"""Chunks in memory: where it plays, the one before, and one that was just looked at."""


class Mark(NamedTuple):
    """A place between two messages: before a message of a chunk; the end has a chunk of its own."""

    chunk: int
    place: int


START = Mark(0, 0)


class _Numbered(msgspec.Struct):
    round: int = 0
    level: int = 0


_numbers_in = msgspec.json.Decoder(_Numbered).decode


class Reel:
    """The messages of a recording in the order of writing, whether it is a file or in memory."""

    def __init__(self, recording: Recording) -> None:
        """Read nothing yet."""
        self.recording = recording
        self.by_wall = recording.parameters.get("log_time") == "wall"
        """Whether log time is the wall clock, so that rounds or levels stand in messages alone."""
        self._chunks = recording.chunks()
        self._kept: OrderedDict[int, Sequence[Record]] = OrderedDict()
        self._free = recording.clock == "free"
        self.end = Mark(len(self._chunks), 0)

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

    def settled(self, mark: Mark) -> Mark:
        """Return the mark of the next message that there is, at or after a mark; or the end."""
        chunk, place = mark
        while chunk < self.end.chunk and place >= len(self.chunk(chunk)):
            chunk, place = chunk + 1, 0
        return Mark(chunk, place)

    def next(self, mark: Mark, kinds: frozenset[str] | None = None) -> tuple[Mark, Record] | None:
        """Return the first message at or after a mark, and where it stands; None at the end.

        Chunks without any of the kinds are not read; other kinds may come all the same.
        """
        chunk, place = mark
        while chunk < self.end.chunk:
            if self._may_hold(chunk, kinds):
                records = self.chunk(chunk)
                if place < len(records):
                    return Mark(chunk, place), records[place]
            chunk, place = chunk + 1, 0
        return None

    def backward(
        self, mark: Mark, kinds: frozenset[str] | None = None
    ) -> Iterator[tuple[Mark, Record]]:
        """Yield the messages before a mark, the last one first; chunks as for `next`."""
        chunk, place = mark
        while True:
            records = self.chunk(chunk) if place else ()
            while place > 0:
                place -= 1
                yield Mark(chunk, place), records[place]
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
        return 0 if found is None else found[1].wall_ns

    @cached_property
    def seconds(self) -> float:
        """The publish time of the last message."""
        last = next(self.backward(self.end), None)
        return 0.0 if last is None else self.time_of(last[1])

    def time_of(self, record: Record) -> float:
        """Return when a message was published, in seconds since the first one."""
        return (record.wall_ns - self.began_ns) / 1e9

    def time_at(self, mark: Mark) -> float:
        """Return when the message at a mark was published; at the end when the last one was."""
        found = self.next(mark)
        return self.seconds if found is None else self.time_of(found[1])

    # Steps: rounds or levels.

    def step_at(self, mark: Mark) -> int:
        """Return the round or level of the message at a mark; at the end that of the last one."""
        if self.by_wall:
            place = bisect_right(self._rises, (self.settled(mark), 0x7FFFFFFFFFFFFFFF))
            return self._rises[place - 1][1] if place else 0
        found = self.next(mark) or next(self.backward(mark), None)
        return 0 if found is None else found[1].round

    @cached_property
    def _rises(self) -> list[tuple[Mark, int]]:
        """Where the round or level rises, where log time does not tell: all is read for it."""
        found: list[tuple[Mark, int]] = []
        last = 0
        each = self.next(START)
        while each is not None:
            mark, record = each
            told = self._number_in(record)
            if told > last:
                found.append((mark, told))
                last = told
            each = self.next(Mark(mark.chunk, mark.place + 1))
        return found

    def _number_in(self, record: Record) -> int:
        if self._free and record.kind != "moved":
            return 0
        try:
            found = _numbers_in(record.data)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            return 0  # whoever plays it says what is wrong
        return found.level if self._free else found.round

    # Places.

    def find(self, spot: Spot, *, after: bool = False) -> Mark:
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
                        return Mark(number, place)
        return self.end

    def _at_time(self, seconds: float, *, after: bool) -> Mark:
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
        return self.settled(Mark(low, first))
