"""The messages of a file, read a chunk at a time.

It touches the file that it was opened with.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence, Set as AbstractSet
from functools import cached_property
from itertools import chain
from math import inf
from typing import overload

from cubepath.protocol.recordings.counts import Counts
from cubepath.protocol.recordings.logged import round_in
from cubepath.protocol.recordings.mcap_file import ChunkIndex, StoredBytes
from cubepath.protocol.recordings.records import Record, RecordChunk, chunk_of
from cubepath.protocol.recordings.salvaging import Salvage, SalvagedMessage, messages_in
from cubepath.protocol.wire.on_record import topic_said


class StoredRecords(Sequence[Record]):
    """The messages of a file, read a chunk at a time whenever they are asked for."""

    def __init__(
        self, stored: StoredBytes, found: Salvage, counts: Counts | None, *, by_wall: bool
    ) -> None:
        self.counts = counts
        self._stored = stored
        self._by_wall = by_wall
        """Whether log times are the wall clock, in a run with rounds."""
        self._chunks = found.blocks
        self._loose = found.loose
        if by_wall:
            self._loose = [each._replace(round=round_in(each)) for each in found.loose]
        self._topics = found.topics
        self.lost = 0
        """The number of messages whose topic is lost."""
        named = found.topics.keys() >= {message.channel for message in found.loose}
        if not named or any("" in block.kinds for block in found.blocks):
            self.lost = found.messages - sum(1 for _ in self)
        self._count = found.messages - self.lost

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[Record]:
        return chain.from_iterable(records for records, _ in self.blocks())

    @overload
    def __getitem__(self, index: int) -> Record: ...

    @overload
    def __getitem__(self, index: slice) -> tuple[Record, ...]: ...

    def __getitem__(self, index: int | slice) -> Record | tuple[Record, ...]:
        """Return a message, or some, at the cost of reading all."""
        return tuple(self)[index]

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Sequence):
            return NotImplemented
        return len(self) == len(other) and all(a == b for a, b in zip(self, other, strict=True))

    __hash__ = None  # type: ignore[assignment]  # as a list

    @cached_property
    def _blocks(self) -> list[ChunkIndex]:
        """The chunks with their rounds, for which all are read if log times are the wall clock."""
        if not self._by_wall:
            return self._chunks
        found: list[ChunkIndex] = []
        for block in self._chunks:
            rounds = [round_in(message) for message in messages_in(self._stored, block)]
            found.append(block._replace(first_round=min(rounds), last_round=max(rounds)))
        return found

    def sha256(self) -> str:
        """Return the SHA-256 of the file in hexadecimal."""
        return self._stored.sha256()

    @property
    def topics(self) -> frozenset[str]:
        """The topics of the messages."""
        if self.lost or any("" in block.kinds for block in self._chunks):
            return frozenset(record.topic for record in self)
        loose = {record.topic for record in self._named(self._loose)}
        return frozenset({*loose, *self._topics.values()})

    def blocks(self) -> Iterator[tuple[Iterable[Record], float]]:
        """Yield messages, each time with the least round of those to come."""
        rounds = [message.round for message in self._loose]
        least = [min(rounds, default=inf)]
        for block in reversed(self._blocks):
            least.append(min(block.first_round, least[-1]))
        for block, ahead in zip(self._blocks, reversed(least[:-1]), strict=True):
            yield self._records(messages_in(self._stored, block)), ahead
        yield self._named(self._loose), inf

    def chunks(self) -> list[RecordChunk]:
        """Return the chunks of the file in order, those outside of chunks last."""

        def reader(block: ChunkIndex) -> Callable[[], Sequence[Record]]:
            return lambda: tuple(self._records(messages_in(self._stored, block)))

        found = [RecordChunk(*block[2:], reader(block)) for block in self._blocks]
        loose = tuple(self._named(self._loose))
        return [*found, chunk_of(loose)] if loose else found

    def near(self, kinds: AbstractSet[str] | None, rounds: range | None) -> Iterator[Record]:
        """Yield the messages of all chunks that may hold some of these kinds and rounds."""
        ends = None if rounds is None else sorted([*rounds[:1], *rounds[-1:]])
        for block in self._chunks if ends is None else self._blocks:
            if kinds is not None and "" not in block.kinds and kinds.isdisjoint(block.kinds):
                continue
            if ends is not None and (
                not ends or ends[-1] < block.first_round or ends[0] > block.last_round
            ):
                continue
            yield from self._records(messages_in(self._stored, block))
        yield from self._named(self._loose)

    def _records(self, messages: Iterable[SalvagedMessage]) -> Iterator[Record]:
        if self._by_wall:
            messages = (each._replace(round=round_in(each)) for each in messages)
        return self._named(messages)

    def _named(self, messages: Iterable[SalvagedMessage]) -> Iterator[Record]:
        topics = self._topics
        # A killed writer leaves no summary, so a channel can be lost with the chunk that named it.
        for channel, sequence, number, wall_ns, data in messages:
            topic = topics.get(channel) or topic_said(data)
            if topic is not None:
                yield Record(topic, data, number, wall_ns, sequence)
