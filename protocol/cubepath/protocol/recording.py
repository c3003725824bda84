"""Recordings: one MCAP file a run, written as it goes and read back with everything checked.

Every message stands in it with the very bytes that were on the wire, on the topic KIND/SENDER,
with its JSON Schema. Log time is the logical round, publish time the wall clock in nanoseconds,
sequence the order of writing. The parameters and versions of the run are a metadata record, the
scene is the attachment `scene.toml`. Chunks carry CRCs and are flushed every few messages, so a
process that is killed loses at most those since the last flush.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Self

import msgspec
from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, Chunk, Footer, Message, Metadata, Schema
from mcap.stream_reader import CRCValidationError, StreamReader, breakup_chunk
from mcap.writer import CompressionType, Writer

from cubepath.protocol.errors import CheckError, InputError
from cubepath.protocol.files import scene_from_toml, scene_to_toml
from cubepath.protocol.messages import schema_of
from cubepath.protocol.systems import Scene

FORMAT = "cubepath-recording-1"
SCENE = "scene.toml"
FLUSH_EVERY = 50
"""Messages between two flushes: a kill loses fewer than this, and what was still in a queue."""
_RECORD_BYTES_MAX = 1 << 30


class RecordingFull(CheckError):  # noqa: N818 - named for what is the case
    """The recording cannot be written any further; what was flushed can be read."""


class RecordingWriter:
    """Writes a run to an MCAP file; use as a context manager, which closes the file properly."""

    def __init__(self, path: Path, scene: Scene, parameters: Mapping[str, str]) -> None:
        """Create the file with the scene and the parameters; InputError where it cannot be."""
        self.path = path
        self.messages = 0
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._stream: IO[bytes] = path.open("wb")
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {error.strerror or error}") from None
        self._writer = Writer(self._stream, compression=CompressionType.ZSTD, enable_data_crcs=True)
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._broken = False
        self._guard(lambda: self._begin(scene, parameters))

    def _begin(self, scene: Scene, parameters: Mapping[str, str]) -> None:
        self._writer.start(profile="cubepath", library="cubepath")
        self._writer.add_metadata("cubepath", {"format": FORMAT, **parameters})
        self._writer.add_attachment(
            create_time=0,
            log_time=0,
            name=SCENE,
            media_type="application/toml",
            data=scene_to_toml(scene).encode(),
        )
        self._writer.flush()

    def _guard(self, write: Callable[[], object]) -> None:
        if self._broken:
            raise RecordingFull(f"{self.path}: the recording had to stop before")
        try:
            write()
        except OSError as error:
            self._broken = True
            raise RecordingFull(
                f"{self.path}: recording stopped after {self.messages} messages:"
                f" {error.strerror or error}"
            ) from None

    def write(self, topic: str, data: bytes, *, round_number: int, wall_ns: int) -> None:
        """Append a message as it was on the wire; RecordingFull where the disk takes no more."""
        self._guard(lambda: self._add(topic, data, round_number, wall_ns))

    def _add(self, topic: str, data: bytes, round_number: int, wall_ns: int) -> None:
        channel = self._channels.get(topic)
        if channel is None:
            channel = self._channels[topic] = self._writer.register_channel(
                topic, "json", self._schema(topic.partition("/")[0])
            )
        self._writer.add_message(
            channel,
            log_time=round_number,
            data=data,
            publish_time=wall_ns,
            sequence=self.messages,
        )
        self.messages += 1
        if self.messages % FLUSH_EVERY == 0:
            self._writer.flush()

    def _schema(self, kind: str) -> int:
        known = self._schemas.get(kind)
        if known is None:
            text = msgspec.json.encode(schema_of(kind))
            known = self._writer.register_schema(f"cubepath.{kind}", "jsonschema", text)
            self._schemas[kind] = known
        return known

    def close(self) -> None:
        """Finish the file; after a full disk, leave what was flushed as it is."""
        if self._stream.closed:
            return
        try:
            if not self._broken:
                self._guard(self._writer.finish)
        finally:
            # After a full disk the tail of the buffer does not fit either.
            with contextlib.suppress(OSError):
                self._stream.close()

    def __enter__(self) -> Self:
        """Return the writer."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file."""
        self.close()


@dataclass(frozen=True, slots=True)
class Record:
    """One message of a recording."""

    topic: str
    data: bytes
    round: int
    wall_ns: int
    sequence: int

    @property
    def kind(self) -> str:
        """Return the kind of the message, the first part of its topic."""
        return self.topic.partition("/")[0]


@dataclass(frozen=True, slots=True)
class Recording:
    """What could be read of a recording; `problems` is empty when that is all of it."""

    path: Path
    parameters: Mapping[str, str]
    scene: Scene
    records: tuple[Record, ...]
    problems: tuple[str, ...]

    def of_kind(self, *kinds: str) -> Iterator[Record]:
        """Yield the messages of these kinds in order."""
        return (record for record in self.records if record.kind in kinds)


@dataclass(slots=True)
class _Raw:
    """Everything found in a file, before it is made sense of."""

    metadata: dict[str, str] | None = None
    scene: bytes | None = None
    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    messages: list[Message] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    finished: bool = False


def read_recording(path: Path) -> Recording:
    """Read a recording with every check on; what is wrong is named in `problems`.

    A truncated file gives all whole chunks, a corrupt chunk is left out by itself. InputError
    where the file is no recording, or has lost its parameters or its scene.
    """
    raw = _read_raw(path)
    if raw.metadata is None or raw.metadata.get("format") != FORMAT:
        found = raw.metadata.get("format") if raw.metadata else "none"
        detail = f" ({raw.problems[0]})" if raw.problems else ""
        raise InputError(
            f"{path}: no cubepath recording: format {found!r}, expected {FORMAT!r}{detail}"
        )
    if raw.scene is None:
        raise InputError(f"{path}: the attachment {SCENE} is missing, nothing can be checked")
    try:
        scene = scene_from_toml(raw.scene.decode(), f"{path} ({SCENE})")
    except UnicodeDecodeError:
        raise InputError(f"{path}: the attachment {SCENE} is corrupt") from None
    records, lost = [], 0
    for message in raw.messages:
        channel = raw.channels.get(message.channel_id)
        if channel is None:
            lost += 1
            continue
        records.append(
            Record(
                channel.topic,
                message.data,
                message.log_time,
                message.publish_time,
                message.sequence,
            )
        )
    if lost:
        raw.problems.append(f"{lost} messages belong to channels that are lost")
    return Recording(path, raw.metadata, scene, tuple(records), tuple(raw.problems))


def _read_raw(path: Path) -> _Raw:
    raw = _Raw()
    try:
        with path.open("rb") as stream:
            if not stream.read(1):
                raise InputError(f"{path}: empty file, expected an MCAP recording")
            stream.seek(0)
            _read_records(stream, raw)
        if not raw.problems:
            with path.open("rb") as stream:
                _check_data(stream, raw)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    return raw


def _read_records(stream: IO[bytes], raw: _Raw) -> None:
    reader = StreamReader(stream, emit_chunks=True, record_size_limit=_RECORD_BYTES_MAX)
    chunks = 0
    try:
        for record in reader.records:
            match record:
                case Metadata(name="cubepath"):
                    raw.metadata = dict(record.metadata)
                case Attachment() if record.name == SCENE:
                    raw.scene = record.data
                case Chunk():
                    chunks += 1
                    _read_chunk(record, chunks, raw)
                case Channel():
                    raw.channels[record.id] = record
                case Schema():
                    raw.schemas[record.id] = record
                case Footer():
                    raw.finished = True
                case _:
                    pass
    except (McapError, ValueError, EOFError, MemoryError, LookupError) as error:
        if raw.finished:
            raw.problems.append("truncated: the closing magic is missing")
        else:
            kind = type(error).__name__
            what = "truncated" if kind == "EndOfFile" else f"corrupt: {error or kind}"
            raw.problems.append(
                f"{what} at byte {stream.tell()}: {chunks} chunks and {len(raw.messages)}"
                " messages could be read before it"
            )


def _read_chunk(chunk: Chunk, number: int, raw: _Raw) -> None:
    try:
        records = breakup_chunk(chunk, validate_crc=True)
    except Exception as error:  # noqa: BLE001 - the decompressors raise errors of their own
        raw.problems.append(
            f"corrupt: chunk {number} (rounds {chunk.message_start_time} to"
            f" {chunk.message_end_time}) cannot be read: {error}"
        )
        return
    for record in records:
        match record:
            case Channel():
                raw.channels[record.id] = record
            case Schema():
                raw.schemas[record.id] = record
            case Message():
                raw.messages.append(record)
            case _:
                pass


def _check_data(stream: IO[bytes], raw: _Raw) -> None:
    # Attachments and metadata have no CRC of their own that the reader checks: the data CRC has.
    try:
        for _ in StreamReader(stream, emit_chunks=True, validate_crcs=True).records:
            pass
    except CRCValidationError as error:
        raw.problems.append(f"corrupt: {error}")


def copy_recording(recording: Recording, out: Path) -> int:
    """Write what could be read as a proper recording; return the number of messages."""
    with RecordingWriter(out, recording.scene, _without_format(recording.parameters)) as writer:
        for record in recording.records:
            writer.write(
                record.topic, record.data, round_number=record.round, wall_ns=record.wall_ns
            )
        return writer.messages


def _without_format(parameters: Mapping[str, str]) -> dict[str, str]:
    return {key: value for key, value in parameters.items() if key != "format"}
