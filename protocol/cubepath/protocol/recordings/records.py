"""The messages of a recording as they stand: one, and a chunk of them, read when needed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.recordings.counts import BATCHES
from cubepath.protocol.wire.on_record import parts_said


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

    def __str__(self) -> str:
        """Return which message it is, as error messages have it."""
        return f"message {self.sequence} ({self.topic})"

    @property
    def kind(self) -> str:
        """Return the kind of the message, the first part of its topic."""
        return self.topic.partition("/")[0]

    def parts(self) -> Iterator[Record]:
        """Yield the parts of a batch, each as it would stand alone; any other record is its part.

        They have the round, the wall clock and the sequence of the batch. A batch that cannot be
        decoded is yielded as it is, so that whoever decodes it finds what is wrong.
        """
        if self.kind not in BATCHES:
            yield self
            return
        try:
            parts = parts_said(self.kind, self.data)
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
