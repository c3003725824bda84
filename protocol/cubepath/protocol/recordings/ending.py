"""The summary at the end of a finished MCAP file: where its records are, and its channels.

It is believed if its CRC holds, and then tells where every chunk, attachment and metadata record
begins, and how long it is, whatever has become of their heads.
"""

from __future__ import annotations

import struct
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from io import BytesIO
from typing import NamedTuple, TypeAlias

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, Channel, Footer, MetadataIndex, Statistics

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.recordings.framing import CRC, HEAD, MAGIC, expect_crc
from cubepath.protocol.recordings.stored import Stored

_CHUNK_INDEX = struct.Struct("<QQQQI")
_CHANNEL_OFFSET = struct.Struct("<HQ")
_FOOTER_BYTES = 20


class Block(NamedTuple):
    """A chunk: where its content stands, and the rounds and kinds of its messages.

    The kind of a message is the first part of its topic, "" where the topic is not known yet.
    """

    offset: int
    length: int
    first_round: int
    last_round: int
    kinds: frozenset[str]


@dataclass(frozen=True, slots=True)
class End:
    """The summary of a finished file, if its CRC holds: where records begin."""

    summary_start: int
    offsets: list[int]
    topics: dict[int, str]
    blocks: list[Block]
    others: list[int]
    """Where attachments and metadata begin, in the order of the file."""
    heads: dict[int, tuple[int, int]]
    """By where a record begins, its kind and the length of its body."""
    covered: int
    """The bytes of chunks, with the indices of their messages, attachments and metadata."""
    statistics: Statistics | None

    def after(self, offset: int) -> int:
        """Return where the next record after `offset` begins."""
        place = bisect_right(self.offsets, offset)
        return self.offsets[place] if place < len(self.offsets) else self.summary_start


Sets: TypeAlias = dict[frozenset[str], frozenset[str]]


def shared(known: Sets, kinds: Iterable[str]) -> frozenset[str]:
    """Return the kinds as a set; equal ones are one object, since there are few of them."""
    found = frozenset(kinds)
    return known.setdefault(found, found)


def kind_in(topic: str) -> str:
    """Return the kind of messages on a topic, its first part."""
    return topic.partition("/")[0]


def end_of(stored: Stored) -> End | None:
    """Return the end of a finished file; None if it is missing or its CRC does not hold."""
    closing = HEAD.size + _FOOTER_BYTES + len(MAGIC)
    footer_at = stored.size - closing
    if footer_at < len(MAGIC):
        return None
    last = stored.read(footer_at, closing)
    if not last.endswith(MAGIC) or HEAD.unpack_from(last) != (Opcode.FOOTER, _FOOTER_BYTES):
        return None
    try:
        footer = Footer.read(ReadDataStream(BytesIO(last[HEAD.size :])))
        start = footer.summary_start or footer_at
        if not len(MAGIC) <= start <= footer_at:
            return None
        summary = stored.read(start, stored.size - start)
        if footer.summary_crc:
            expect_crc(summary[: -len(MAGIC) - CRC.size], footer.summary_crc)
        return _summary(summary, start, footer_at)
    except InputError:
        raise
    except Exception:  # noqa: BLE001 - whatever is wrong, there is no usable summary
        return None


def _summary(data: bytes, start: int, footer_at: int) -> End:
    others: list[int] = []
    heads: dict[int, tuple[int, int]] = {}
    topics: dict[int, str] = {}
    chunks: list[bytes] = []
    covered = 0
    statistics: Statistics | None = None
    for opcode, body in _records(data[: footer_at - start]):
        stream = ReadDataStream(BytesIO(body))
        match opcode:
            case Opcode.CHUNK_INDEX:
                chunks.append(body)
            case Opcode.ATTACHMENT_INDEX:
                attachment = AttachmentIndex.read(stream)
                others.append(attachment.offset)
                covered += attachment.length
                heads[attachment.offset] = Opcode.ATTACHMENT, attachment.length - HEAD.size
            case Opcode.METADATA_INDEX:
                metadata = MetadataIndex.read(stream)
                others.append(metadata.offset)
                covered += metadata.length
                heads[metadata.offset] = Opcode.METADATA, metadata.length - HEAD.size
            case Opcode.CHANNEL:
                channel = Channel.read(stream)
                topics[channel.id] = channel.topic
            case Opcode.STATISTICS:
                statistics = Statistics.read(stream)
            case _:
                pass
    blocks = sorted(_indexed(chunks, topics), key=lambda block: block.offset)
    covered += sum(HEAD.size + block.length for block in blocks)
    heads |= {each.offset - HEAD.size: (Opcode.CHUNK, each.length) for each in blocks}
    covered += sum(_index_length(body) for body in chunks)
    offsets = sorted([block.offset - HEAD.size for block in blocks] + others)
    return End(start, offsets, topics, blocks, sorted(others), heads, covered, statistics)


def _records(data: bytes) -> Iterator[tuple[int, bytes]]:
    offset = 0
    while offset < len(data):
        opcode, length = HEAD.unpack_from(data, offset)
        offset += HEAD.size
        yield opcode, data[offset : offset + length]
        offset += length


def _indexed(chunks: Iterable[bytes], topics: Mapping[int, str]) -> Iterator[Block]:
    """Yield the chunks of these indices.

    mcap's own reader takes seconds for the channels of a long recording.
    """
    named = {channel: kind_in(topic) for channel, topic in topics.items()}
    sets: Sets = {}
    for body in chunks:
        first, last, offset, length, size = _CHUNK_INDEX.unpack_from(body)
        used = body[_CHUNK_INDEX.size : _CHUNK_INDEX.size + size]
        kinds = {named.get(channel, "") for channel, _ in _CHANNEL_OFFSET.iter_unpack(used)}
        yield Block(
            offset + HEAD.size, length - HEAD.size, first, last, shared(sets, kinds or {""})
        )


def _index_length(body: bytes) -> int:
    """Return the bytes of the indices of messages that follow a chunk."""
    size = _CHUNK_INDEX.unpack_from(body)[4]
    return int.from_bytes(body[_CHUNK_INDEX.size + size :][:8], "little")
