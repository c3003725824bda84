"""Recordings wrecked at random, and what must come of them, by a reader of the obvious kind."""

import random
import struct
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import NamedTuple

import zstandard

from cubepath.protocol.recordings.recording import read_recording
from cubepath.protocol.recordings.writing import RecordingWriter
from samples.recordings import new_path, recorded

_GOLDEN = Path(__file__).parents[2] / "logs" / "golden"
_CHUNK, _CHANNEL, _MESSAGE, _DATA_END = 6, 4, 5, 15


class Kept(NamedTuple):
    """A message as it must come back, byte for byte and with its times."""

    topic: str
    log_time: int
    publish_time: int
    data: bytes


@dataclass(frozen=True, slots=True)
class Whole:
    """An undamaged recording: where its chunks begin and end, and the messages of each."""

    name: str
    data: bytes
    chunks: list[tuple[int, int, list[Kept]]]

    @property
    def messages(self) -> list[Kept]:
        """Return all messages, in order."""
        return [message for _, _, held in self.chunks for message in held]


def taken_apart(name: str, data: bytes) -> Whole:
    """Return the chunks of an undamaged file: heads, lengths and zstd, and no checks at all."""
    topics: dict[int, str] = {}
    chunks: list[tuple[int, int, list[Kept]]] = []
    offset = 8
    while offset < len(data):
        kind, length = struct.unpack_from("<BQ", data, offset)
        end = offset + 9 + length
        if kind == _DATA_END:
            break
        if kind == _CHUNK:
            size = struct.unpack_from("<Q", data, offset + 9 + 16)[0]
            name_length = struct.unpack_from("<I", data, offset + 9 + 28)[0]
            packed = data[offset + 9 + 40 + name_length : end]
            content = zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)
            chunks.append((offset, end, _messages(content, topics)))
        offset = end
    return Whole(name, data, chunks)


def _messages(content: bytes, topics: dict[int, str]) -> list[Kept]:
    found: list[Kept] = []
    offset = 0
    while offset < len(content):
        kind, length = struct.unpack_from("<BQ", content, offset)
        body = content[offset + 9 : offset + 9 + length]
        if kind == _CHANNEL:
            channel, _, size = struct.unpack_from("<HHI", body)
            topics[channel] = body[8 : 8 + size].decode()
        elif kind == _MESSAGE:
            channel, _, log_time, publish_time = struct.unpack_from("<HIQQ", body)
            found.append(Kept(topics[channel], log_time, publish_time, body[22:]))
        offset += 9 + length
    return found


@cache
def wholes() -> tuple[Whole, ...]:
    """Return golden recordings of all formats, and fresh ones of many chunks, closed or not."""
    found = [taken_apart(path.name, path.read_bytes()) for path in sorted(_GOLDEN.glob("*.mcap"))]
    made = [
        recorded("agv:graph=grid4x4,n=5", seed=3, rounds=12),
        recorded("hex:n=6", seed=1, rounds=15, hesitate=0.3),
        read_recording(_GOLDEN / "hex-free-5.mcap"),
    ]
    for number, recording in enumerate(made):
        path = new_path()
        with RecordingWriter(
            path, recording.scene, recording.parameters, written_as=recording.format
        ) as writer:
            for record in recording.records:
                writer.write(
                    record.topic, record.data, round_number=record.round, wall_ns=record.wall_ns
                )
                if writer.messages % 9 == 0:
                    writer.flush()
            writer.flush()
            killed = path.read_bytes()
        found.append(taken_apart(f"fresh {number}", path.read_bytes()))
        found.append(taken_apart(f"killed {number}", killed))
    return tuple(found)


class Wreck(NamedTuple):
    """A damaged recording, and the messages of each of its chunks that no damage touched."""

    whole: Whole
    data: bytes
    undamaged: list[Kept]


def wreck(seed: int) -> Wreck:
    """Return a recording that was truncated, or in which bits were flipped, or both."""
    chance = random.Random(seed)  # noqa: S311 - not for secrets
    whole = wholes()[seed % len(wholes())]
    size = len(whole.data)
    how = chance.choice(["cut", "flip", "flips", "both"])
    end = chance.randrange(size) if how in ("cut", "both") else size
    data = bytearray(whole.data[:end])
    places: set[int] = set()
    flips = {"cut": 0, "flip": 1, "flips": chance.randint(2, 8), "both": chance.randint(1, 4)}[how]
    for _ in range(flips if data else 0):
        # Half of them where records begin, of which a chunk of zeros and ones knows nothing.
        near = chance.choice([0, *(begin for begin, _, _ in whole.chunks)])
        place = chance.choice([chance.randrange(end), min(near + chance.randrange(60), end - 1)])
        bit = 1 << chance.randrange(8)
        data[place] ^= bit
        if data[place] == whole.data[place]:
            places.discard(place)
        else:
            places.add(place)
    kept = [
        message
        for begin, stop, held in whole.chunks
        if stop <= end and not any(begin <= place < stop for place in places)
        for message in held
    ]
    return Wreck(whole, bytes(data), kept)
