"""Recordings: one MCAP file per run, written during the run and checked when read back.

A recording holds every message as the exact bytes that were on the wire, on the topic KIND/SENDER,
with its JSON Schema. Log time is the logical round, or without rounds the level or the wall clock;
publish time is the wall clock in nanoseconds, and sequence the order of writing. The parameters and
versions of the run are a metadata record, the scene is the attachment `scene.toml`, and an executed
schedule is `schedule.jsonl`. Chunks carry CRCs and are written when they are full, when half a
second has passed, and when the caller says so, which a run does after each round: so a killed
process loses less than a second, and no finished round.
"""

from __future__ import annotations

import contextlib
import errno
import os
import stat
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, replace
from itertools import chain
from math import inf
from pathlib import Path
from typing import IO, Self, overload

import msgspec

from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.input_files import InputFile, Source, opened
from cubepath.protocol.core.output_files import same_file, unwritable, written_whole
from cubepath.protocol.core.system import Scene
from cubepath.protocol.recordings.appending import McapAppender
from cubepath.protocol.recordings.counts import BATCHES, Counts, counts_of
from cubepath.protocol.recordings.counts import METADATA as COUNTS
from cubepath.protocol.recordings.description import (
    FORMAT,
    METADATA,
    SCENE,
    SCHEDULE,
    Clock,
    clock_of,
    format_of,
    metadata_of,
    parameters_in,
    scene_in,
)
from cubepath.protocol.recordings.salvaging import (
    MAGIC,
    Message,
    Salvage,
    messages_in,
    outline,
    salvage,
)
from cubepath.protocol.recordings.stored import Stored
from cubepath.protocol.scenes.toml import scene_to_toml
from cubepath.protocol.wire.on_record import parts_said, schema_of, topic_said

FLUSH_S = 0.5
"""Seconds after which a message is written, with those that came meanwhile."""
CHUNK_BYTES = 1 << 18
"""And so many bytes, if they come first; four times as many save 2%, and damage costs more."""
TOPICS_MAX = (1 << 16) - 1
"""Channels of an MCAP file have numbers of 16 bits, and none has the number 0."""


class RecordingFull(CheckError):  # noqa: N818 - named for a state
    """The recording cannot be continued; what was flushed can be read.

    If the file was removed or cut, which are other causes, nothing or little can be read.
    """


class RecordingWriter:
    """Writes a run to an MCAP file; use as a context manager, which closes the file properly."""

    def __init__(
        self,
        path: Path,
        scene: Scene,
        parameters: Mapping[str, str],
        schedule: bytes | None = None,
        *,
        stream: IO[bytes] | None = None,
        written_as: str | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Create the file with the scene and the parameters; InputError if it cannot be created.

        `schedule` is the text of the schedule that the run executes. A `stream` is written in place
        of a new file, in full chunks: it stays open, and its errors propagate. `written_as` is the
        format that its messages are in, told and not looked at; if it is left out, it follows from
        the clock in the parameters. `clock` says, in seconds, when messages have waited for long.
        """
        self._format = written_as or format_of(parameters)
        self.path = path
        self.messages = 0
        self._counts = Counts()
        self._clock = clock
        self._due: float | None = None
        """When what waits to be written must be; None if nothing waits."""
        self._owns = stream is None
        text = scene_to_toml(scene)  # before the file is created: not every scene can be written
        self._stream = _new_file(path) if stream is None else stream
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._broken = False
        self._size = 0
        try:
            self._guard(lambda: self._begin(text, parameters, schedule))
        except RecordingFull:
            self.close()
            raise

    def _begin(self, scene: str, parameters: Mapping[str, str], schedule: bytes | None) -> None:
        self._writer = McapAppender(self._stream, "cubepath")
        self._writer.add_metadata(METADATA, metadata_of(parameters, self._format))
        self._writer.add_attachment(SCENE, "application/toml", scene.encode())
        if schedule is not None:
            self._writer.add_attachment(SCHEDULE, "application/jsonl", schedule)
        self._flush()

    def _guard(self, write: Callable[[], object]) -> None:
        if self._broken:
            raise RecordingFull(f"{self.path}: the recording had to stop before")
        try:
            write()
        except OSError as error:
            self._broken = True
            if not self._owns:
                raise
            raise RecordingFull(
                f"{self.path}: recording stopped after {self.messages} messages:"
                f" {error.strerror or error}"
            ) from None

    def write(self, topic: str, data: bytes, *, round_number: int, wall_ns: int) -> None:
        """Append a message with the bytes that were on the wire, at its log time.

        Raises RecordingFull if the disk is full, or the file was removed, moved or cut.
        """
        if self._broken:
            self._guard(self._flush)
        if not 0 <= round_number < 1 << 64:
            raise InputError(
                f"{self.path}: message {self.messages} ({topic}) is of round {round_number},"
                " expected 0 or more, in 64 bits"
            )
        channel = self._channels.get(topic) or self._channel(topic)
        writer = self._writer
        writer.add_message(channel, self.messages, round_number, wall_ns, data)
        self.messages += 1
        self._counts.add(topic, data, wall_ns)
        if writer.size > CHUNK_BYTES or self._is_due():
            self._guard(self._flush)

    def _channel(self, topic: str) -> int:
        if len(self._channels) == TOPICS_MAX:
            raise InputError(
                f"{self.path}: message {self.messages} ({topic}) is on one more topic than a"
                f" recording can have, expected {TOPICS_MAX} at most"
            )
        schema = self._schema(topic.partition("/")[0])
        found = self._channels[topic] = self._writer.add_channel(topic, "json", schema)
        return found

    def _is_due(self) -> bool:
        """Return whether a message has waited for long, with the one that was just appended."""
        if not self._owns:
            return False  # nobody reads a copy before it is complete
        now = self._clock()
        self._due = now + FLUSH_S if self._due is None else self._due
        return now >= self._due

    def flush_if_due(self) -> None:
        """Write what was appended if it has waited for long; who waits calls it time and again."""
        if self._due is not None and self._clock() >= self._due:
            self.flush()

    def flush(self) -> None:
        """Write what was appended, so that it can be read whatever happens."""
        if self._writer.size:
            self._guard(self._flush)

    def _flush(self) -> None:
        self._check_size()
        self._writer.close_chunk()
        self._check_place()
        self._due = None

    def _check_size(self) -> None:
        """Check that nothing was cut off; the next write would fill the gap with zeros."""
        found = os.fstat(self._stream.fileno())
        if stat.S_ISREG(found.st_mode) and found.st_size < self._size:
            why = f"its file was cut to {found.st_size} bytes, expected at least {self._size}"
            raise OSError(errno.EIO, why)

    def _check_place(self) -> None:
        """Check that the path still leads to the whole file; otherwise it would be lost."""
        if not self._owns:
            return
        found = os.fstat(self._stream.fileno())
        if not stat.S_ISREG(found.st_mode):
            return
        self._size = found.st_size
        with contextlib.suppress(OSError):
            if os.path.samestat(found, self.path.stat()):
                return
        raise FileNotFoundError(errno.ENOENT, "its file was removed or moved")

    def _schema(self, kind: str) -> int:
        known = self._schemas.get(kind)
        if known is None:
            text = msgspec.json.encode(schema_of(kind))
            known = self._writer.add_schema(f"cubepath.{kind}", "jsonschema", text)
            self._schemas[kind] = known
        return known

    def _finish(self) -> None:
        self._check_size()
        self._writer.close_chunk()
        self._counts.messages = self.messages  # by which they are numbered, so a gap does not fit
        self._writer.add_metadata(COUNTS, self._counts.to_metadata())
        self._writer.finish()
        self._stream.flush()  # what closing the file could not write would not be told
        self._check_place()

    def close(self) -> None:
        """Finish the file; after a failure to write, leave what was flushed as it is."""
        if self._stream.closed:
            return
        try:
            if not self._broken:
                self._guard(self._finish)
        finally:
            if self._owns:
                # After a full disk the tail of the buffer does not fit either.
                with contextlib.suppress(OSError):
                    self._stream.close()

    def __enter__(self) -> Self:
        """Return the writer."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file."""
        self.close()


def _new_file(path: Path) -> IO[bytes]:
    try:
        with contextlib.suppress(FileExistsError):  # opening it gives the reason
            path.parent.mkdir(parents=True, exist_ok=True)
        # Earlier recordings are never overwritten; a device may be written to.
        new = path.is_file() or not path.exists()
        return path.open("xb" if new else "wb")
    except FileExistsError:
        raise _exists(path) from None
    except OSError as error:
        raise unwritable(path, error) from None


def _exists(path: Path) -> InputError:
    return InputError(f"{path}: exists already, expected a new file")


@dataclass(frozen=True, slots=True)
class Record:
    """One message of a recording."""

    topic: str
    data: bytes
    round: int
    """The log time: a round, or without rounds a level or a wall time in nanoseconds."""
    wall_ns: int
    sequence: int

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


class _StoredRecords(Sequence[Record]):
    """The messages of a file, read a chunk at a time whenever they are asked for."""

    def __init__(self, stored: Stored, found: Salvage, counts: Counts | None) -> None:
        self.counts = counts
        self._stored = stored
        self._blocks = found.blocks
        self._loose = found.loose
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

    def blocks(self) -> Iterator[tuple[Iterable[Record], float]]:
        rounds = [message.round for message in self._loose]
        least = [min(rounds, default=inf)]
        for block in reversed(self._blocks):
            least.append(min(block.first_round, least[-1]))
        for block, ahead in zip(self._blocks, reversed(least[:-1]), strict=True):
            yield self._records(messages_in(self._stored, block)), ahead
        yield self._records(self._loose), inf

    def of_kinds(self, kinds: AbstractSet[str]) -> Iterator[Record]:
        for block in self._blocks:
            if "" in block.kinds or not kinds.isdisjoint(block.kinds):
                yield from self._records(messages_in(self._stored, block))
        yield from self._records(self._loose)

    def _records(self, messages: Iterable[Message]) -> Iterator[Record]:
        topics = self._topics
        # A killed writer leaves no summary, so a channel can be lost with the chunk that named it.
        for channel, sequence, number, wall_ns, data in messages:
            topic = topics.get(channel) or topic_said(data)
            if topic is not None:
                yield Record(topic, data, number, wall_ns, sequence)


@dataclass(frozen=True, slots=True)
class Recording:
    """What could be read of a recording; `problems` is empty if that is everything.

    Its messages may stay in the file, and are then read whenever they are asked for.
    """

    path: Path
    parameters: Mapping[str, str]
    scene: Scene
    records: Sequence[Record]
    problems: tuple[str, ...]
    schedule: bytes | None = None
    """The text of the schedule that was executed, if any."""
    size: int = 0
    """Number of bytes read."""
    format: str = FORMAT

    @property
    def clock(self) -> Clock:
        """Return the clock of the run: "lockstep" has rounds, "free" has none."""
        return clock_of(self.format)

    def of_kind(self, *kinds: str) -> Iterator[Record]:
        """Yield the messages of these kinds in order, also those that are parts of batches."""
        batches = {batch for batch, held in BATCHES.items() if not held.isdisjoint(kinds)}
        records: Iterable[Record] = self.records
        if isinstance(records, _StoredRecords):
            records = records.of_kinds({*kinds, *batches})
        for record in records:
            if record.kind in kinds:
                yield record
            elif record.kind in batches:
                for part in record.parts():
                    # What cannot be decoded may have held some.
                    if part.kind in kinds or part.kind in batches:
                        yield part

    def blocks(self) -> Iterator[tuple[Iterable[Record], float]]:
        """Yield the messages some at a time, each time with the least round of those to come.

        That is the round under which they were written; infinity if nothing is to come. So what was
        collected of the rounds before it is complete.
        """
        if isinstance(self.records, _StoredRecords):
            return self.records.blocks()
        return iter([(self.records, inf)])

    def counts(self) -> Counts:
        """Return how much is in the recording; it is read only if the file does not say so."""
        records = self.records
        if isinstance(records, _StoredRecords) and records.counts is not None:
            return records.counts
        found = Counts()
        for record in records:
            found.add(record.topic, record.data, record.wall_ns)
        return found


def is_recording(file: InputFile) -> bool:
    """Return whether a file begins like a recording, or is cut off within its first bytes."""
    head = file.head(len(MAGIC))
    return bool(head) and MAGIC.startswith(head)


def read_recording(source: Source) -> Recording:
    """Read a recording with all checks; `problems` lists what is wrong.

    A truncated file yields all its whole chunks, and only a corrupt chunk itself is left out. No
    message is returned without a valid CRC. If the CRCs of the whole file hold, messages are not
    looked at before they are asked for. Raises InputError if the file is no recording, or has lost
    its parameters or its scene.
    """
    with opened(source) as file:
        stored = Stored(file)
    path = stored.path
    if not stored.size:
        raise InputError(f"{path}: empty file, expected an MCAP recording")
    whole = outline(stored)
    counts = None if whole is None else counts_of(whole)
    found = salvage(stored) if whole is None or counts is None else whole
    problems = list(found.problems)
    written_as, parameters = parameters_in(path, found, problems)
    scene = scene_in(path, found)
    records = _StoredRecords(stored, found, counts)
    if records.lost:
        problems.append(f"{records.lost} messages belong to channels that are lost")
    if found.gap is not None and not problems:
        problems.append(found.gap)
    schedules = (each.data for each in found.attachments if each.name == SCHEDULE)
    schedule = next(schedules, None)
    return Recording(
        path, parameters, scene, records, tuple(problems), schedule, stored.size, written_as
    )


def read_undamaged(source: Source) -> Recording:
    """Read an undamaged recording; InputError names the damage and how to recover the rest."""
    recording = read_recording(source)
    if recording.problems:
        path = recording.path
        raise InputError(
            f"{path}: {'; '.join(recording.problems)}."
            f" 'cubepath verify {path} --recover OUT' writes what can be read"
        )
    return recording


def copy_recording(recording: Recording, out: Path, notes: Mapping[str, str] | None = None) -> int:
    """Write what could be read as a complete recording, in its format; return the message count.

    `notes` are parameters to add. Raises InputError if `out` is the recording itself, exists
    already or cannot be written, and CheckError if the disk is full; then nothing is left of it.
    """
    if same_file(out, recording.path):
        raise InputError(f"{out}: is the recording itself, expected another file to write to")
    parameters = {**recording.parameters, **(notes or {})}
    if out.is_file():
        raise _exists(out)
    with (
        written_whole(out) as stream,
        RecordingWriter(
            out,
            recording.scene,
            parameters,
            recording.schedule,
            stream=stream,
            written_as=recording.format,
        ) as writer,
    ):
        for record in recording.records:
            writer.write(
                record.topic, record.data, round_number=record.round, wall_ns=record.wall_ns
            )
        return writer.messages
