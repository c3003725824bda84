"""The messages of a recording, decoded one after another.

At any time a chunk of the file is in memory, and no more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import msgspec

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import did_you_mean
from cubepath.protocol.recordings.counts import BATCHES
from cubepath.protocol.wire.free_messages import (
    FREE_KINDS,
    Asks,
    Passes,
    Shows,
    Tells,
    Turns,
    decode_free,
)
from cubepath.protocol.wire.messages import KINDS, Message, decode, parts_of

if TYPE_CHECKING:
    from collections.abc import Set as AbstractSet
    from pathlib import Path

    from cubepath.protocol.recordings.description import Clock
    from cubepath.protocol.recordings.records import Record
    from cubepath.protocol.recordings.salvaging import SalvagedMessage as Stored

_BOTH = ("go", "refused", "edges", "cube", "certificate", "summary")
"""Kinds of messages that runs with rounds and runs without have."""


class MessageSource(Protocol):
    """What messages are read from; a `Recording` is one."""

    @property
    def path(self) -> Path:
        """Where it was read from."""
        ...

    @property
    def clock(self) -> Clock:
        """The clock of the run."""
        ...

    def written(
        self, kinds: AbstractSet[str] | None = None, rounds: range | None = None
    ) -> Iterator[Record]:
        """Yield the messages of these kinds and log times in order, batches as they stand."""
        ...


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


def round_in(stored: Stored) -> int:
    """Return the round that a message tells, if its log time is the wall clock.

    If that is neither so, nor the message one with a round, its log time stands for the round:
    verifying names it.
    """
    told = told_round(stored.data) if stored.round == stored.wall_ns else None
    return stored.round if told is None else told


def told_round(data: bytes) -> int | None:
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
    recording: MessageSource,
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
    recording: MessageSource, wanted: frozenset[str] | None, rounds: range | None
) -> Iterator[LoggedMessage]:
    read, split = (decode_free, _parts) if recording.clock == "free" else (decode, _parts_of_rounds)
    batches = {kind for kind, held in BATCHES.items() if wanted and not held.isdisjoint(wanted)}
    looked_at = None if wanted is None else wanted | batches
    for record in recording.written(looked_at, rounds):
        message = _read(recording, record.topic, record.sequence, read, record.data)
        when = record.round, record.wall_ns, record.topic, record.sequence
        if wanted is None or record.kind in wanted:
            yield LoggedMessage(message, *when)
        else:
            for part in split(message):
                if part.__struct_config__.tag in wanted:
                    yield LoggedMessage(part, *when)


def _read(
    recording: MessageSource, topic: str, sequence: int, read: Callable[[bytes], Any], data: bytes
) -> Any:
    try:
        return read(data)
    except InputError as error:
        raise InputError(f"{recording.path}: message {sequence} ({topic}): {error}") from None


def _parts_of_rounds(message: Message) -> Iterable[msgspec.Struct]:
    return parts_of(message)


def _parts(message: msgspec.Struct) -> Iterable[msgspec.Struct]:
    """Return the parts of a batch of a run without rounds."""
    if isinstance(message, Asks | Passes | Tells | Shows | Turns):
        return message.parts
    return (message,)
