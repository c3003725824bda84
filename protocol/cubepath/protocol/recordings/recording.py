"""Recordings: one MCAP file per run, written during the run and checked when read back.

A recording holds every message as the exact bytes that were on the wire, on the topic KIND/SENDER,
with its JSON Schema. Log time is the logical round, publish time the wall clock in nanoseconds, and
sequence the order of writing. The parameters and versions of the run are a metadata record, the
scene is the attachment `scene.toml`, and an executed schedule is `schedule.jsonl`. Chunks carry
CRCs and are flushed every few messages, so a killed process loses at most the messages since the
last flush.
"""

from __future__ import annotations

import contextlib
import errno
import os
import stat
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import IO, Self

import msgspec
from mcap.writer import CompressionType, Writer

from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.input_files import InputFile, Source, opened
from cubepath.protocol.core.output_files import same_file, unwritable, written_whole
from cubepath.protocol.core.system import Scene
from cubepath.protocol.recordings.salvaging import MAGIC, Salvage, salvage
from cubepath.protocol.scenes.toml import scene_from_toml, scene_to_toml
from cubepath.protocol.wire.keys import topic_of
from cubepath.protocol.wire.messages import (
    Acts,
    Again,
    Message,
    Observations,
    Reports,
    Said,
    Waiting,
    decode,
    encode,
    kind_of,
    parts_of,
    schema_of,
)

FORMAT = "cubepath-recording-2"
"""The format that is written: modules may say messages in batches, `said` and `reports`."""
FORMATS = ("cubepath-recording-1", FORMAT)
"""The formats that are read. In the first every part is a message of its own."""
SCENE = "scene.toml"
SCHEDULE = "schedule.jsonl"
FLUSH_EVERY = 50
"""Messages between two flushes: a kill loses fewer than this, and those still in a queue."""
TOPICS_MAX = (1 << 16) - 1
"""Channels of an MCAP file have numbers of 16 bits, and none has the number 0."""
_METADATA = "cubepath"
_BATCHES = {
    "said": {"here", "note", "claim", "verdict"},
    "reports": {"report"},
    "observations": {"observed"},
    "acts": {"act"},
}
"""The kinds of messages that are batches, with the kinds of their parts."""


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
    ) -> None:
        """Create the file with the scene and the parameters; InputError if it cannot be created.

        `schedule` is the text of the schedule that the run executes. A `stream` is written in place
        of a new file: it stays open, and its errors propagate.
        """
        self.path = path
        self.messages = 0
        self._owns = stream is None
        text = scene_to_toml(scene)  # before the file is created: not every scene can be written
        self._stream = _new_file(path) if stream is None else stream
        self._writer = Writer(self._stream, compression=CompressionType.ZSTD, enable_data_crcs=True)
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
        self._writer.start(profile="cubepath", library="cubepath")
        self._writer.add_metadata(
            _METADATA, {**parameters, "format": FORMAT, "checksum": _checksum(parameters)}
        )
        self._attach(SCENE, "application/toml", scene.encode())
        if schedule is not None:
            self._attach(SCHEDULE, "application/jsonl", schedule)
        self._flush()

    def _attach(self, name: str, media_type: str, data: bytes) -> None:
        self._writer.add_attachment(
            create_time=0, log_time=0, name=name, media_type=media_type, data=data
        )

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
        """Append a message with the bytes that were on the wire.

        Raises RecordingFull if the disk is full, or the file was removed, moved or cut.
        """
        self._guard(lambda: self._add(topic, data, round_number, wall_ns))

    def _add(self, topic: str, data: bytes, round_number: int, wall_ns: int) -> None:
        if not 0 <= round_number < 1 << 64:
            raise InputError(
                f"{self.path}: message {self.messages} ({topic}) is of round {round_number},"
                " expected 0 or more, in 64 bits"
            )
        channel = self._channels.get(topic)
        if channel is None:
            if len(self._channels) == TOPICS_MAX:
                raise InputError(
                    f"{self.path}: message {self.messages} ({topic}) is on one more topic than a"
                    f" recording can have, expected {TOPICS_MAX} at most"
                )
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
            self._flush()

    def _flush(self) -> None:
        self._check_size()
        self._writer.flush()
        self._check_place()

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
            known = self._writer.register_schema(f"cubepath.{kind}", "jsonschema", text)
            self._schemas[kind] = known
        return known

    def _finish(self) -> None:
        self._check_size()
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
        if self.kind not in _BATCHES:
            yield self
            return
        try:
            parts = parts_of(decode(self.data))
        except InputError:
            yield self
            return
        for part in parts:
            yield replace(self, topic=topic_of(part), data=encode(part))


@dataclass(frozen=True, slots=True)
class Recording:
    """What could be read of a recording; `problems` is empty if that is everything."""

    path: Path
    parameters: Mapping[str, str]
    scene: Scene
    records: tuple[Record, ...]
    problems: tuple[str, ...]
    schedule: bytes | None = None
    """The text of the schedule that was executed, if any."""
    size: int = 0
    """Number of bytes read."""
    format: str = FORMAT

    def of_kind(self, *kinds: str) -> Iterator[Record]:
        """Yield the messages of these kinds in order, also those that are parts of batches."""
        batches = {batch for batch, held in _BATCHES.items() if not held.isdisjoint(kinds)}
        for record in self.records:
            if record.kind in kinds:
                yield record
            elif record.kind in batches:
                for part in record.parts():
                    # What cannot be decoded may have held some.
                    if part.kind in kinds or part.kind in batches:
                        yield part


def topic_on_record(message: Message) -> str:
    """Return the topic under which a message stands; batches are said by processes."""
    if isinstance(message, Said | Reports | Observations | Acts | Again | Waiting):
        return f"{kind_of(message)}/process_{message.process}"
    return topic_of(message)


def is_recording(file: InputFile) -> bool:
    """Return whether a file begins like a recording, or is cut off within its first bytes."""
    head = file.head(len(MAGIC))
    return bool(head) and MAGIC.startswith(head)


def read_recording(source: Source) -> Recording:
    """Read a recording with all checks; `problems` lists what is wrong.

    A truncated file yields all its whole chunks, and only a corrupt chunk itself is left out. No
    message is returned without a valid CRC. Raises InputError if the file is no recording, or has
    lost its parameters or its scene.
    """
    with opened(source) as file:
        path, data = file.path, file.whole()
    if not data:
        raise InputError(f"{path}: empty file, expected an MCAP recording")
    found = salvage(data)
    problems = list(found.problems)
    written_as, parameters = _parameters(path, found, problems)
    scene = _scene(path, found)
    records, lost = _records(found)
    if lost:
        problems.append(f"{lost} messages belong to channels that are lost")
    if not problems:
        problems += _gap(records)
    schedules = (each.data for each in found.attachments if each.name == SCHEDULE)
    schedule = next(schedules, None)
    return Recording(
        path, parameters, scene, records, tuple(problems), schedule, len(data), written_as
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


def _parameters(path: Path, found: Salvage, problems: list[str]) -> tuple[str, dict[str, str]]:
    """Return the format and the parameters."""
    named = [record.metadata for record in found.metadata if record.name == _METADATA]
    ours = [values for values in named if values.get("format") in FORMATS]
    if not ours:
        shown = repr(named[0].get("format")) if named else "none"
        detail = f" ({problems[0]})" if problems else ""
        expected = " or ".join(map(repr, FORMATS))
        raise InputError(
            f"{path}: no cubepath recording: format {shown}, expected {expected}{detail}"
        )
    values = {key: value for key, value in ours[0].items() if key not in ("format", "checksum")}
    if ours[0].get("checksum") != _checksum(values):
        problems.append("corrupt: the parameters are not those of their checksum")
    return ours[0]["format"], values


def _checksum(parameters: Mapping[str, str]) -> str:
    # A metadata record has no CRC, and the CRC of the data section comes at the end of the file.
    return sha256(msgspec.json.encode(sorted(parameters.items()))).hexdigest()


def _scene(path: Path, found: Salvage) -> Scene:
    for attachment in found.attachments:
        if attachment.name == SCENE:
            where = f"{path} ({SCENE})"
            try:
                text = attachment.data.decode()
            except UnicodeDecodeError as error:
                raise InputError(f"{where}: not UTF-8 text (byte {error.start})") from None
            return scene_from_toml(text, where)
    raise InputError(f"{path}: the attachment {SCENE} is lost, so nothing can be checked")


def _records(found: Salvage) -> tuple[tuple[Record, ...], int]:
    """Return the messages with their topics, and the number of messages whose topic is lost."""
    records, lost = [], 0
    for message in found.messages:
        topic = found.topics.get(message.channel_id) or _topic_said(message.data)
        if topic is None:
            lost += 1
            continue
        records.append(
            Record(
                topic,
                message.data,
                message.log_time,
                message.publish_time,
                message.sequence,
            )
        )
    return tuple(records), lost


def _topic_said(data: bytes) -> str | None:
    # A killed writer leaves no summary, so a channel can be lost with the chunk that named it.
    try:
        return topic_on_record(decode(data))
    except InputError:
        return None


def _gap(records: Iterable[Record]) -> Iterator[str]:
    """Yield the first error in the order of writing, if any."""
    for expected, record in enumerate(records):
        if record.sequence != expected:
            yield f"message {record.sequence} stands where message {expected} should be"
            return


def copy_recording(recording: Recording, out: Path, notes: Mapping[str, str] | None = None) -> int:
    """Write what could be read as a complete recording; return the number of messages.

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
            out, recording.scene, parameters, recording.schedule, stream=stream
        ) as writer,
    ):
        for record in recording.records:
            writer.write(
                record.topic, record.data, round_number=record.round, wall_ns=record.wall_ns
            )
        return writer.messages
