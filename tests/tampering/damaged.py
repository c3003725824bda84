"""Recordings to damage: what is in them, and what must hold whatever is done to them."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory

from mcap.records import Chunk
from mcap.stream_reader import StreamReader

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import InputFile
from cubepath.protocol.recordings.mcap_file import StoredBytes
from cubepath.protocol.recordings.recording import Recording, read_recording
from cubepath.protocol.recordings.salvaging import (
    SalvagedMessage as FoundMessage,
    messages_in,
    salvage,
)
from cubepath.protocol.recordings.stored_messages import Record
from cubepath.protocol.recordings.writing import RecordingWriter
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.messages import Go, Message, Presence, Ready, encode

PARAMETERS = {"rule": "random", "seed": "7", "system": "agv:graph=P3,n=1", "": "ünï\ncode"}
ROUNDS = 40
FLUSH_EVERY = 50
"""Messages of a chunk."""
SCENE_OF_ALL = scene_from_spec("agv:graph=P3,n=1")


def said() -> Iterator[tuple[str, Message]]:
    """Yield enough messages for several chunks."""
    for number in range(1, ROUNDS + 1):
        yield "go/coordinator", Go(number, "sense")
        for module in range(4):
            yield (
                f"presence/module_{module}",
                Presence(number, module, (number, -module, "x" * module)),
            )
        yield "ready/process_0", Ready(number, 0, "sense")


def write(path: Path, *, close: bool = True) -> None:
    """Write over the path; without `close` as after a flush when the writer is killed."""
    path.unlink(missing_ok=True)
    writer = RecordingWriter(path, SCENE_OF_ALL, PARAMETERS)
    for place, (topic, message) in enumerate(said()):
        writer.write(topic, encode(message), round_number=message.round, wall_ns=10**18 + place)
        if writer.messages % FLUSH_EVERY == 0:
            writer.flush()
    if close:
        writer.close()
        return
    whole = path.read_bytes()
    writer.close()
    path.write_bytes(whole)


@cache
def files() -> tuple[bytes, bytes]:
    """Return the bytes of a closed recording, and of one whose writer was killed."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "a.mcap"
        write(path)
        closed = path.read_bytes()
        write(path, close=False)
        return closed, path.read_bytes()


@cache
def originals() -> tuple[Record, ...]:
    """Return all messages as they were written."""
    return tuple(
        Record(topic, encode(message), message.round, 10**18 + place, place)
        for place, (topic, message) in enumerate(said())
    )


def reading(data: bytes) -> Recording | None:
    """Read the bytes as a recording; None where they are refused, in one line that names them."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "damaged.mcap"
        path.write_bytes(data)
        try:
            return read_recording(path)
        except InputError as error:
            refusal = str(error)
    assert "damaged.mcap" in refusal
    assert "\n" not in refusal
    return None


@dataclass(frozen=True, slots=True)
class Salvaged:
    """What `salvage` finds in some bytes, with the messages."""

    messages: list[FoundMessage]
    topics: dict[int, str]
    metadata: list[str]
    attachments: list[str]
    problems: list[str]


def stored(data: bytes) -> StoredBytes:
    """Return bytes as those of a recording that was read from a pipe."""
    return StoredBytes(InputFile(Path("damaged.mcap"), BytesIO(data)))


def salvaged(data: bytes) -> Salvaged:
    """Return what can be read of the bytes of an MCAP file."""
    source = stored(data)
    found = salvage(source)
    messages = [each for block in found.blocks for each in messages_in(source, block)]
    assert len(messages) == found.messages
    return Salvaged(
        messages,
        found.topics,
        [each.name for each in found.metadata],
        [each.name for each in found.attachments],
        found.problems,
    )


def chunks_of(data: bytes) -> list[tuple[int, int]]:
    """Return where the content of each chunk begins and ends."""
    reader = StreamReader(BytesIO(data), emit_chunks=True)
    found = [record.data for record in reader.records if isinstance(record, Chunk)]
    return [(place := data.index(content), place + len(content)) for content in found]


def flipped(data: bytes, place: int, bit: int = 0) -> bytes:
    """Return the bytes with one bit changed."""
    return data[:place] + bytes([data[place] ^ 1 << bit]) + data[place + 1 :]


def assert_honest(found: Recording | None, *, prefix: bool = False) -> None:
    """Assert that damage is named, and that every message given is one that was written."""
    if found is None:
        return
    assert found.problems
    assert all("\n" not in problem for problem in found.problems)
    assert all(record == originals()[record.sequence] for record in found.records)
    places = [record.sequence for record in found.records]
    assert places == sorted(set(places))
    if prefix:
        assert places == list(range(len(places)))
