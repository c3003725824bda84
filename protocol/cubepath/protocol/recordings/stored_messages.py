"""The messages of a recording: as stored, one chunk at a time, and decoded one after another.

At any time at most one chunk of the file is in memory.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence, Set as AbstractSet
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import chain
from math import inf
from typing import TYPE_CHECKING, Any, NamedTuple, overload

import msgspec

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import did_you_mean
from cubepath.protocol.recordings.description import BATCHES, Clock, Counts
from cubepath.protocol.recordings.mcap_file import ChunkIndex, StoredBytes, kind_in
from cubepath.protocol.recordings.plain_messages import PutSettings
from cubepath.protocol.recordings.salvaging import Salvage, SalvagedMessage, messages_in
from cubepath.protocol.wire.free_messages import FREE_KINDS, decode_free
from cubepath.protocol.wire.messages import KINDS, decode
from cubepath.protocol.wire.on_record import parts_in, topic_in

if TYPE_CHECKING:
    from cubepath.protocol.recordings.recording import Recording


# Not frozen, which would take four times as long to make: a long recording has millions.
@dataclass(unsafe_hash=True, slots=True)
class Record:
    """One message of a recording.

    >>> record = next(iter(read_recording("logs/golden/hex-5.mcap").of_kind("summary")))
    >>> record.topic, record.round, decode(record.data).ended
    ('summary/coordinator', 29, 'goal')
    """

    topic: str
    data: bytes
    round: int
    """The round; without rounds the log time, which is a level or a wall time in nanoseconds."""
    wall_ns: int
    sequence: int
    put: PutSettings | None = None
    """How it was put; None if it is a message of a run."""

    def __str__(self) -> str:
        """Return which message it is, as error messages have it."""
        return f"message {self.sequence} ({self.topic})"

    @property
    def kind(self) -> str:
        """Return the kind of the message, the first part of its topic."""
        return kind_in(self.topic)

    def parts(self) -> Iterator[Record]:
        """Yield the parts of a batch, each as it would stand alone; any other record is its part.

        They have the round, the wall clock and the sequence of the batch. A batch that cannot be
        decoded is yielded as it is, so that decoding it shows what is wrong.
        """
        if self.kind not in BATCHES:
            yield self
            return
        try:
            parts = parts_in(self.kind, self.data)
        except InputError:
            yield self
            return
        for topic, data in parts:
            yield replace(self, topic=topic, data=data)


@dataclass(frozen=True, slots=True)
class RecordChunk:
    """Some messages that follow one another, and stay in the file until they are asked for."""

    first_round: int
    last_round: int
    """The least and the greatest log time of them."""
    kinds: frozenset[str]
    """The kinds of the messages, "" for those whose topic is lost."""
    read: Callable[[], Sequence[Record]]
    """Returns the messages, in the order of writing; none may be left of a damaged chunk."""


def chunk_of(records: Sequence[Record]) -> RecordChunk:
    """Return messages that are in no file as a chunk."""
    rounds = [record.round for record in records]
    kinds = frozenset(record.kind for record in records)
    return RecordChunk(min(rounds), max(rounds), kinds, lambda: records)


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
        self._puts = found.puts
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
        topics, puts = self._topics, self._puts
        # A killed writer leaves no summary, so a channel can be lost with the chunk that named it.
        for channel, sequence, number, wall_ns, data in messages:
            topic = topics.get(channel) or topic_in(data)
            if topic is not None:
                yield Record(topic, data, number, wall_ns, sequence, puts.get(channel))


_BOTH = ("go", "refused", "edges", "cube", "certificate", "summary")
"""Kinds of messages that runs with rounds and runs without have."""


class LoggedMessage(NamedTuple):
    """A message of a recording, and when it was written."""

    message: Any
    """The message itself, or a part of a batch: docs/recordings.md has the kinds and fields."""
    round: int
    """The round; without rounds the log time, the level or the wall clock in nanoseconds."""
    wall_ns: int
    """The publish time: the wall clock in nanoseconds."""
    topic: str
    """The topic under which it was recorded; of a part that of its batch."""
    sequence: int
    """The number of the message in the order of writing; of a part that of its batch."""


class _Rounded(msgspec.Struct, gc=False):
    round: int


_rounded = msgspec.json.Decoder(_Rounded).decode


def round_in(stored: SalvagedMessage) -> int:
    """Return the round that a message tells, if its log time is the wall clock.

    If that is neither so, nor the message one with a round, its log time stands for the round:
    verifying names it.
    """
    number = round_of_data(stored.data) if stored.round == stored.wall_ns else None
    return stored.round if number is None else number


def round_of_data(data: bytes) -> int | None:
    """Return the round that a message tells, None if it tells none."""
    try:
        return _rounded(data).round
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None


@cache
def kinds_of(clock: Clock) -> frozenset[str]:
    """Return the kinds of messages and of their parts that a run under a clock may have."""
    own = {*KINDS} if clock == "lockstep" else {*FREE_KINDS, *_BOTH}
    return frozenset(own).union(*(held for batch, held in BATCHES.items() if batch in own))


def messages_of(
    recording: Recording,
    kinds: str | Iterable[str] | None = None,
    rounds: int | range | None = None,
) -> Iterator[LoggedMessage]:
    """Yield messages, decoded, in the order of writing; `Recording.messages` documents it."""
    wanted = None if kinds is None else frozenset([kinds] if isinstance(kinds, str) else kinds)
    known = kinds_of(recording.clock)
    for kind in sorted((wanted or frozenset()) - known):
        near = did_you_mean(kind, known)
        raise InputError(
            f"unknown kind {kind!r}{near}, expected some of {', '.join(sorted(known))}"
        )
    if isinstance(rounds, int):
        rounds = range(rounds, rounds + 1)
    return _decoded(recording, wanted, rounds)


def _decoded(
    recording: Recording, wanted: frozenset[str] | None, rounds: range | None
) -> Iterator[LoggedMessage]:
    read: Callable[[bytes], Any] = decode_free if recording.clock == "free" else decode
    batches = {kind for kind, held in BATCHES.items() if wanted and not held.isdisjoint(wanted)}
    looked_at = None if wanted is None else wanted | batches
    for record in recording.written(looked_at, rounds):
        try:
            message = read(record.data)
        except InputError as error:
            raise InputError(f"{recording.path}: {record}: {error}") from None
        when = record.round, record.wall_ns, record.topic, record.sequence
        if wanted is None or record.kind in wanted:
            yield LoggedMessage(message, *when)
        else:
            for part in getattr(message, "parts", (message,)):
                if part.__struct_config__.tag in wanted:
                    yield LoggedMessage(part, *when)
