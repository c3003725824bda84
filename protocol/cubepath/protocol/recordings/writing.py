"""Writing recordings, during a run or as the copy of another.

`recording` says what stands where.
"""

from __future__ import annotations

import contextlib
import errno
import os
import stat
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from itertools import chain
from pathlib import Path
from typing import IO, TYPE_CHECKING, Self, cast

import msgspec
from mcap.writer import CompressionType, Writer

from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.output_files import (
    is_special,
    new_file,
    same_file,
    special_file,
    unwritable,
    written_whole,
)
from cubepath.protocol.core.system import Scene
from cubepath.protocol.recordings import description
from cubepath.protocol.recordings.mcap_file import kind_in
from cubepath.protocol.recordings.plain_messages import PutSettings, key_in
from cubepath.protocol.scenes.toml import scene_to_toml
from cubepath.protocol.wire.on_record import schema_of

if TYPE_CHECKING:
    from cubepath.protocol.recordings.recording import Recording
    from cubepath.protocol.recordings.stored_messages import Record

FLUSH_S = 0.5
"""Seconds after which a message is written, with those that came meanwhile."""
CHUNK_BYTES = 1 << 18
"""And this many bytes, if they come first; four times as many save 2%, and damage costs more."""
_CHANNEL_BYTES = 64
"""More than a channel or schema takes beside its texts; both stand in the summary once more."""
_COUNTS_BYTES = 1 << 13
"""More than the counts at the end take."""
_MESSAGE_BYTES = 31
"""What a message takes beside its data."""
_INDEX_BYTES = 45
"""More than the index of a chunk takes beside 10 bytes for a channel and 16 for a message."""
TOPICS_MAX = (1 << 16) - 1
"""Channels of an MCAP file have numbers of 16 bits, and none has the number 0."""


_PUT_PLAINLY = PutSettings()


class RecordingFull(CheckError):  # noqa: N818 - named for a state
    """The recording cannot be continued; what was flushed can be read.

    If the file was removed or cut, which are other causes, nothing or little can be read.
    """


class CountedStream:
    """A stream that knows how much was written: a pipe cannot tell."""

    def __init__(self, stream: IO[bytes]) -> None:
        self._stream = stream
        self.written = 0

    def write(self, data: bytes) -> None:
        """Write bytes, and count them."""
        self.written += len(data)
        self._stream.write(data)

    def tell(self) -> int:
        """Return how much was written."""
        return self.written

    def flush(self) -> None:
        """Flush the stream."""
        self._stream.flush()


def mcap_writer(stream: CountedStream, profile: str, chunk_bytes: int = sys.maxsize) -> Writer:
    """Return the writer of the mcap package, with all CRCs."""
    writer = Writer(
        cast("IO[bytes]", stream),  # all that it asks for
        chunk_size=chunk_bytes,
        compression=CompressionType.ZSTD,
        enable_data_crcs=True,
    )
    writer.start(profile, profile)
    return writer


class RecordingWriter:
    """Writes a run to an MCAP file; use as a context manager, which closes the file properly.

    >>> with RecordingWriter("own.mcap", scene_from_spec("hex:n=3"), {"rule": "by hand"}) as writer:
    ...     pass
    >>> read_recording("own.mcap").parameters["rule"]
    'by hand'
    """

    def __init__(
        self,
        path: Path | str,
        scene: Scene | None,
        parameters: Mapping[str, str],
        schedule: bytes | None = None,
        *,
        stream: IO[bytes] | None = None,
        written_as: str | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Create the file with the scene and the parameters; InputError if it cannot be created.

        Both are written once more at the end of the file. A scene that is lost is None: then the
        messages can be read by other tools, and as a recording once its scene is supplied again.
        `schedule` is the text of the schedule that the run executes. A `stream` is written in place
        of a new file, in full chunks: it stays open, and its errors propagate. `written_as` is the
        format that its messages are in, given and not inspected; if it is left out, it follows from
        the clock in the parameters. `clock` says, in seconds, when messages have waited for long.
        """
        self._format = written_as or description.format_of(parameters)
        self.path = path = Path(path)
        self.messages = 0
        self._of_keys = self._format == description.KEYS_FORMAT
        self._counts = description.Counts(by_topic=self._of_keys)
        self._clock = clock
        self._due: float | None = None
        """When what waits to be written must be; None if nothing waits."""
        self._owns = stream is None
        # Before the file is created: not every scene can be written.
        self._scene = None if scene is None else scene_to_toml(scene).encode()
        self._parameters = description.metadata_of(parameters, self._format)
        self._stream = _new_file(path) if stream is None else stream
        self._channels: dict[tuple[str, PutSettings | None], int] = {}
        self._schemas: dict[str, int] = {}
        self._broken = False
        self._size = 0
        # Bytes and messages of the open chunk, and bytes of the summary so far.
        self._open = self._open_messages = self._summary = 0
        self._by_wall = description.has_wall_times(self._format, parameters)
        try:
            self._guard(lambda: self._begin(schedule))
        except RecordingFull:
            self.close()
            raise

    def _begin(self, schedule: bytes | None) -> None:
        self._counted = CountedStream(self._stream)
        self._writer = mcap_writer(self._counted, "cubepath")
        self._describe()
        if schedule is not None:
            self._attach(description.SCHEDULE, "application/jsonl", schedule)
        self._flush()

    def _describe(self) -> None:
        """Write what the recording is of."""
        self._writer.add_metadata(description.METADATA, self._parameters)
        if self._scene is not None:
            self._attach(description.SCENE, "application/toml", self._scene)

    def _attach(self, name: str, media_type: str, data: bytes) -> None:
        self._writer.add_attachment(0, 0, name, media_type, data)

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

    def write(
        self,
        topic: str,
        data: bytes,
        *,
        round_number: int,
        wall_ns: int,
        sequence: int | None = None,
        put: PutSettings | None = None,
    ) -> None:
        """Append a message with the bytes that were on the wire, at its log time.

        That is `round_number` (without rounds the level, or the wall clock), or `wall_ns` if the
        parameter `log_time` of a run with rounds is "wall". `sequence` is its number in the
        recording that it is taken from; by default messages are numbered as they come. `put` says
        how a message on any key was put; then `round_number` is when it was received, and `wall_ns`
        when it was sent. Raises RecordingFull if the disk is full, or the file was removed, moved
        or cut.
        """
        if self._broken:
            self._guard(self._flush)
        for what, at in (("of round", round_number), ("of time", wall_ns)):
            if not 0 <= at < 1 << 64:
                raise InputError(
                    f"{self.path}: message {self.messages} ({topic}) is {what} {at},"
                    " expected 0 or more, in 64 bits"
                )
        put = _PUT_PLAINLY if put is None and self._of_keys else put
        channel = self._channels.get((topic, put)) or self._channel(topic, put)
        number = self.messages if sequence is None else sequence
        log_time = wall_ns if self._by_wall else round_number
        self._writer.add_message(channel, log_time, data, wall_ns, number)
        self.messages += 1
        self._open_messages += 1
        self._open += len(data) + _MESSAGE_BYTES
        self._counts.add(topic, data, log_time if self._of_keys else wall_ns)
        if self._open > CHUNK_BYTES or self._is_due():
            self._guard(self._flush)

    def _channel(self, topic: str, put: PutSettings | None) -> int:
        if len(self._channels) == TOPICS_MAX:
            raise InputError(
                f"{self.path}: message {self.messages} ({topic}) is on one more topic than a"
                f" recording can have, expected {TOPICS_MAX} at most"
            )
        if put is None:
            schema = self._schema(f"cubepath.{kind_in(topic)}", topic)
            found = self._writer.register_channel(topic, "json", schema)
        else:
            plain = topic == key_in(topic)  # neither an attachment nor a deletion
            schema = self._schema(put.schema, None) if plain and put.schema else 0
            encoding = put.mcap_encoding if plain else ""
            settings = put.to_metadata()
            self._grow("".join(chain(*settings.items())))
            found = self._writer.register_channel(topic, encoding, schema, settings)
        self._grow(topic)
        self._channels[topic, put] = found
        return found

    def size_with(self, record: Record) -> int:
        """Return the most bytes of the file if it ends after one more message."""
        topic, put, size = record.topic, record.put, len(record.data)
        new = 0 if (topic, put) in self._channels else len(topic) + _CHANNEL_BYTES
        if put is not None:
            new += 2 * len(put.encoding) + 2 * _CHANNEL_BYTES if new else 0
        elif f"cubepath.{kind_in(topic)}" not in self._schemas:
            new += len(msgspec.json.encode(schema_of(kind_in(topic)))) + _CHANNEL_BYTES
        chunk = self._open + size + _MESSAGE_BYTES + 2 * new
        return (
            self._counted.written
            + chunk
            + chunk // 128  # what cannot be compressed grows by less
            + 16 * (self._open_messages + 1)
            + _INDEX_BYTES * (len(self._channels) + 1)
            + self._summary
            + _COUNTS_BYTES
        )

    def _grow(self, text: str | bytes) -> None:
        """Note a text of a channel or schema, which stands in the open chunk and the summary."""
        self._open += len(text) + _CHANNEL_BYTES
        self._summary += len(text) + _CHANNEL_BYTES

    def _is_due(self) -> bool:
        """Return whether a message has waited for long, with the one that was just appended."""
        if not self._owns:
            return False  # nobody reads a copy before it is complete
        now = self._clock()
        self._due = now + FLUSH_S if self._due is None else self._due
        return now >= self._due

    def has(self, size: int) -> bool:
        """Return whether the file has this many bytes; what waits is written if it may decide."""
        if self._counted.written + self._open >= size:
            self.flush()
        return self._counted.written >= size

    def note(self, name: str, values: Mapping[str, str]) -> None:
        """Write a metadata record of another name than the recording's own."""
        self.flush()
        self._guard(lambda: self._writer.add_metadata(name, dict(values)))

    def flush_if_due(self) -> None:
        """Write what was appended if it has waited for long; who waits calls it time and again."""
        if self._due is not None and self._clock() >= self._due:
            self.flush()

    def flush(self) -> None:
        """Write what was appended, so that it can be read whatever happens."""
        if self._open:
            self._guard(self._flush)

    def _flush(self) -> None:
        self._check_size()
        self._close_chunk()
        self._check_place()
        self._due = None

    def _close_chunk(self) -> None:
        self._writer.flush()
        if self._open_messages:
            self._summary += 2 * _INDEX_BYTES + 10 * len(self._channels)
            self._open = self._open_messages = 0

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

    def _schema(self, name: str, topic: str | None) -> int:
        """Return the number of a schema: that of a topic of a run, or one that is a name alone."""
        known = self._schemas.get(name)
        if known is None and topic is not None:
            text = msgspec.json.encode(schema_of(kind_in(topic)))
            known = self._schemas[name] = self._writer.register_schema(name, "jsonschema", text)
            self._grow(text)
        elif known is None:
            known = self._schemas[name] = self._writer.register_schema(name, "", b"")
        return known

    def _finish(self) -> None:
        self._check_size()
        self._close_chunk()
        self._describe()  # once more, far from the first: damage to one of them costs nothing
        self._counts.messages = self.messages  # by which they are numbered, so a gap does not fit
        self._writer.add_metadata(description.COUNTS, self._counts.to_metadata())
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
        return special_file(path) if is_special(path) else new_file(path)
    except FileExistsError:
        raise _exists(path) from None
    except OSError as error:
        raise unwritable(path, error) from None


def _exists(path: Path) -> InputError:
    return InputError(f"{path}: exists already, expected a new file")


def refuse_existing(path: Path) -> None:
    """Raise InputError if there is a file already: recordings are never overwritten."""
    if path.is_file():
        raise _exists(path)


def refuse_source(recording: Recording, out: Path) -> None:
    """Raise InputError if a file to write is the recording itself, or exists already."""
    if same_file(out, recording.path):
        raise InputError(f"{out}: is the recording itself, expected another file to write to")
    refuse_existing(out)


def copy_to(
    stream: IO[bytes], out: Path, like: Recording, notes: Mapping[str, str]
) -> RecordingWriter:
    """Return a writer of a recording of the same run, with other parameters."""
    return RecordingWriter(
        out, like.stored_scene, notes, like.schedule, stream=stream, written_as=like.format
    )


def append(writer: RecordingWriter, records: Iterable[Record]) -> None:
    """Write messages as they stand, with their times and numbers."""
    for record in records:
        writer.write(
            record.topic,
            record.data,
            round_number=record.round,
            wall_ns=record.wall_ns,
            sequence=record.sequence,
            put=record.put,
        )


def copy_recording(recording: Recording, out: Path, notes: Mapping[str, str] | None = None) -> int:
    """Write what could be read as a complete recording, in its format; return the message count.

    Messages keep their numbers, so that a hole between them can be seen. `notes` are parameters to
    add. Of what remains of a recording without its scene the messages are written alone. Raises
    InputError if `out` is the recording itself, exists already or cannot be written, and CheckError
    if the disk is full; then nothing is left of it.
    """
    refuse_source(recording, out)
    parameters = {**recording.parameters, **(notes or {})}
    with written_whole(out) as stream, copy_to(stream, out, recording, parameters) as writer:
        append(writer, recording.records)
        return writer.messages
