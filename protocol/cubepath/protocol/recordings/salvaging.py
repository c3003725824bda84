"""Salvaging MCAP files: every record is checked, and damage is reported.

Room: protocol. The readers of the mcap package stop at the first damaged record, or raise whatever
their parsers happen to raise. Here records are split one by one, so only a damaged record itself is
left out: each chunk and attachment has a CRC, and so do the data section and the summary. If a
length is damaged and the records after it cannot be found, the index in the summary tells where to
continue. Messages and attachments are returned only if a CRC covers them.

What is found says where the chunks are, not what is in them: messages are unpacked when they are
asked for, a chunk at a time, so that memory does not grow with the file. If the CRCs of a finished
file hold, `outline` finds the same from its end, without going through the records.
"""

from __future__ import annotations

import struct
import zlib
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from io import BytesIO
from typing import NamedTuple, TypeAlias

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    Footer,
    Metadata,
    MetadataIndex,
    Statistics,
)
from mcap.stream_reader import get_chunk_data_stream

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.recordings.stored import Stored

MAGIC = b"\x89MCAP0\r\n"
_CHUNK_BYTES_MAX = 1 << 30
_HEAD = struct.Struct("<BQ")
_CRC = struct.Struct("<I")
_MESSAGE = struct.Struct("<HIQQ")
_CHUNK_INDEX = struct.Struct("<QQQQI")
_CHANNEL_OFFSET = struct.Struct("<HQ")
_FOOTER_BYTES = 20


class Message(NamedTuple):
    """A message as it stands in a file."""

    channel: int
    sequence: int
    round: int
    wall_ns: int
    data: bytes


class Block(NamedTuple):
    """A chunk: where its content stands, and the rounds and kinds of its messages.

    The kind of a message is the first part of its topic, "" where the topic is not known yet.
    """

    offset: int
    length: int
    first_round: int
    last_round: int
    kinds: frozenset[str]


@dataclass(slots=True)
class Salvage:
    """What was found: `problems` is empty if nothing is missing.

    `topics` maps channels to topics. Messages are those of `blocks` and then the `loose` ones, in
    the order of the file; `gap` is the first error in the order of writing, if any.
    """

    metadata: list[Metadata] = field(default_factory=list)
    attachments: list[Attachment] = field(default_factory=list)
    topics: dict[int, str] = field(default_factory=dict)
    blocks: list[Block] = field(default_factory=list)
    loose: list[Message] = field(default_factory=list)
    messages: int = 0
    gap: str | None = None
    problems: list[str] = field(default_factory=list)


def salvage(stored: Stored) -> Salvage:
    """Return what can be read of an MCAP file; whatever its bytes are, nothing is raised.

    InputError if the file cannot be read, or is cut meanwhile.
    """
    scan = _Scan(stored)
    scan.run()
    return scan.found


def outline(stored: Stored) -> Salvage | None:
    """Return what a finished file says of itself, if all its CRCs hold; else None.

    The CRC of the data section covers every byte before it, so no chunk has to be unpacked. What
    the writer itself got wrong, such as a gap, is not seen.
    """
    end = _end_of(stored)
    if end is None or end.statistics is None:
        return None
    try:
        return _outlined(stored, end, end.statistics)
    except Exception:  # noqa: BLE001 - whatever is wrong, `salvage` finds it
        return None


def _outlined(stored: Stored, end: _End, statistics: Statistics) -> Salvage | None:
    data_end = end.summary_start - _HEAD.size - _CRC.size
    told = stored.read(data_end, _HEAD.size + _CRC.size)
    crc = _CRC.unpack(told[_HEAD.size :])[0]
    if _HEAD.unpack_from(told) != (Opcode.DATA_END, _CRC.size) or not crc:
        return None
    header = _HEAD.unpack(stored.read(len(MAGIC), _HEAD.size))[1]
    if len(MAGIC) + _HEAD.size + header + end.covered != data_end:
        return None  # something stands outside of what the summary tells of
    if stored.crc(data_end) != crc:
        return None
    found = Salvage(topics=end.topics, blocks=end.blocks, messages=statistics.message_count)
    for offset in end.others:
        opcode, length = _HEAD.unpack(stored.read(offset, _HEAD.size))
        body = stored.read(offset + _HEAD.size, length)
        stream = ReadDataStream(BytesIO(body))
        if opcode == Opcode.ATTACHMENT:
            found.attachments.append(_attachment(body))
        elif opcode == Opcode.METADATA:
            found.metadata.append(Metadata.read(stream))
        else:
            return None
    return found


def messages_in(stored: Stored, block: Block) -> list[Message]:
    """Return the messages of a block, once more with its CRC; InputError if it does not hold."""
    try:
        body = stored.read(block.offset, block.length)
        _, messages = _unpacked(Chunk.read(ReadDataStream(BytesIO(body))))
    except InputError:
        raise
    except Exception as error:  # noqa: BLE001 - parsers and decompressors raise many kinds
        raise InputError(
            f"{stored.path}: the chunk at byte {block.offset} cannot be read any more:"
            f" {_said(error)}"
        ) from None
    return messages


@dataclass(frozen=True, slots=True)
class _End:
    """The summary of a finished file, if its CRC holds: where records begin."""

    summary_start: int
    offsets: list[int]
    topics: dict[int, str]
    blocks: list[Block]
    others: list[int]
    """Where attachments and metadata begin, in the order of the file."""
    covered: int
    """The bytes of chunks, with the indices of their messages, attachments and metadata."""
    statistics: Statistics | None


class _Scan:
    """One pass over the bytes."""

    def __init__(self, stored: Stored) -> None:
        self.found = Salvage()
        self._stored = stored
        self._chunks = 0
        self._span = ""
        self._loose: list[Channel | Message] = []
        self._ended = False
        self._sets: _Sets = {}

    def run(self) -> None:
        stored, found = self._stored, self.found
        magic = stored.read(0, len(MAGIC))
        if magic != MAGIC:
            short = MAGIC.startswith(magic)
            what = "truncated within its first bytes" if short else "not an MCAP file"
            found.problems.append(f"{what}: expected it to begin with the magic of MCAP")
            return
        end = _end_of(stored)
        if end is not None:
            found.topics.update(end.topics)
        offset = len(MAGIC)
        while not self._ended:
            if end is not None and offset >= end.summary_start:
                found.problems.append(f"corrupt before byte {offset}: no mark ends the data")
                return
            after = self._record(offset, end)
            if after is None:
                found.problems.append(self._stop(offset))
                return
            offset = after
        if end is None:
            found.problems.append(self._tail(offset))

    def _record(self, offset: int, end: _End | None) -> int | None:
        """Read the record at `offset`; return where the next one begins, None if nowhere."""
        stored = self._stored
        start = offset + _HEAD.size
        if start > stored.size:
            return None
        opcode, length = _HEAD.unpack(stored.read(offset, _HEAD.size))
        after: int = start + length
        known = _next(end, offset)
        if after > stored.size or (known is not None and after > known) or not _plausible(opcode):
            if known is None:
                return None
            self.found.problems.append(
                f"corrupt at byte {offset}: a record is damaged, reading goes on at byte {known}"
            )
            return known
        if opcode not in _TAKEN:
            return after
        body = stored.read(start, length)
        try:
            self._take(opcode, body, offset)
        except Exception as error:  # noqa: BLE001 - parsers and decompressors raise many kinds
            self.found.problems.append(f"corrupt at byte {offset}: {self._what(opcode, error)}")
        return after

    def _what(self, opcode: int, error: Exception) -> str:
        if opcode == Opcode.CHUNK:
            return f"chunk {self._chunks}{self._span} cannot be read: {_said(error)}"
        return f"a record of kind {opcode} cannot be read: {_said(error)}"

    def _take(self, opcode: int, body: bytes, offset: int) -> None:
        stream = ReadDataStream(BytesIO(body))
        match opcode:
            case Opcode.CHUNK:
                self._chunks += 1
                self._span = ""
                self._take_chunk(Chunk.read(stream), offset + _HEAD.size, len(body))
            case Opcode.ATTACHMENT:
                self.found.attachments.append(_attachment(body))
            case Opcode.METADATA:
                self.found.metadata.append(Metadata.read(stream))
            case Opcode.CHANNEL:
                self._loose.append(Channel.read(stream))
            case Opcode.MESSAGE:
                self._loose.append(_message(body))
            case _:
                crc = _CRC.unpack(body)[0]
                self._ended = True
                self._take_end(crc, offset)

    def _take_chunk(self, chunk: Chunk, offset: int, length: int) -> None:
        # Its head has no CRC of its own: this only tells users what may be lost.
        self._span = f" (log times {chunk.message_start_time} to {chunk.message_end_time})"
        channels, messages = _unpacked(chunk)
        self._name(channels)
        self._count(messages)
        if messages:
            rounds = [message.round for message in messages]
            topics = {self.found.topics.get(message.channel, "") for message in messages}
            kinds = _shared(self._sets, map(kind_in, topics))
            self.found.blocks.append(Block(offset, length, min(rounds), max(rounds), kinds))

    def _name(self, channels: Iterable[Channel]) -> None:
        for channel in channels:
            self.found.topics[channel.id] = channel.topic

    def _count(self, messages: Iterable[Message]) -> None:
        found = self.found
        for expected, message in enumerate(messages, found.messages):
            found.messages += 1
            if message.sequence != expected and found.gap is None:
                found.gap = f"message {message.sequence} stands where message {expected} should be"

    def _take_end(self, crc: int, offset: int) -> None:
        found = self.found
        # By the specification, 0 means that there is no CRC.
        holds = not crc or self._stored.crc(offset) == crc
        if not holds and not found.problems:
            found.problems.append("corrupt: the CRC of the data section does not hold")
        if holds and crc:
            self._name(each for each in self._loose if isinstance(each, Channel))
            found.loose = [each for each in self._loose if isinstance(each, Message)]
            self._count(found.loose)
        elif self._loose:
            found.problems.append(
                f"{len(self._loose)} records stand outside chunks, and nothing vouches for them"
            )

    def _tail(self, offset: int) -> str:
        """Return what is wrong after the data section, once all messages have been read."""
        size = self._stored.size
        closing = self._stored.read(offset, size - offset).find(MAGIC)
        if closing < 0:
            what = f"truncated at byte {size}: the closing magic is missing"
        elif offset + closing + len(MAGIC) < size:
            more = size - offset - closing - len(MAGIC)
            what = f"corrupt: {more} bytes follow after the end"
        else:
            what = f"corrupt: the summary from byte {offset} on does not hold"
        return f"{what}; all messages could be read"

    def _stop(self, offset: int) -> str:
        stored = self._stored
        # A file that ends properly, or continues with something that is no record, was not cut off.
        cut = stored.read(stored.size - len(MAGIC), len(MAGIC)) != MAGIC and (
            offset + _HEAD.size > stored.size or _plausible(stored.read(offset, 1)[0])
        )
        return (
            f"{'truncated' if cut else 'corrupt'} at byte {offset} of {stored.size}: {self._chunks}"
            f" chunks and {self.found.messages} messages could be read before it"
        )


_TAKEN = {
    Opcode.CHUNK,
    Opcode.ATTACHMENT,
    Opcode.METADATA,
    Opcode.CHANNEL,
    Opcode.MESSAGE,
    Opcode.DATA_END,
}
"""The kinds of records that are read; others, such as indices of messages, are passed over."""


def _unpacked(chunk: Chunk) -> tuple[list[Channel], list[Message]]:
    """Return the channels and messages of a chunk; raises any error if its CRC does not hold."""
    if chunk.uncompressed_size > _CHUNK_BYTES_MAX:
        raise ValueError(f"it claims to hold {chunk.uncompressed_size} bytes")
    if not chunk.uncompressed_crc:
        raise ValueError("it has no checksum")
    stream, size = get_chunk_data_stream(chunk, validate_crc=True)
    data = stream.read(size)
    channels: list[Channel] = []
    messages: list[Message] = []
    offset = 0
    while offset < size:
        opcode, length = _HEAD.unpack_from(data, offset)
        start = offset + _HEAD.size
        offset = start + length
        if offset > size:
            raise ValueError("a record in it is longer than the chunk")
        if opcode == Opcode.MESSAGE:
            messages.append(_message(data[start:offset]))
        elif opcode == Opcode.CHANNEL:
            channels.append(Channel.read(ReadDataStream(BytesIO(data[start:offset]))))
    return channels, messages


def _message(body: bytes) -> Message:
    channel, sequence, number, wall_ns = _MESSAGE.unpack_from(body)
    return Message(channel, sequence, number, wall_ns, body[_MESSAGE.size :])


def _attachment(body: bytes) -> Attachment:
    # mcap's own reader does not check this CRC.
    _expect_crc(body[: -_CRC.size], _CRC.unpack(body[-_CRC.size :])[0])
    found: Attachment = Attachment.read(ReadDataStream(BytesIO(body)))
    return found


_Sets: TypeAlias = dict[frozenset[str], frozenset[str]]


def _shared(known: _Sets, kinds: Iterable[str]) -> frozenset[str]:
    """Return the kinds as a set; equal ones are one object, since there are few of them."""
    found = frozenset(kinds)
    return known.setdefault(found, found)


def kind_in(topic: str) -> str:
    """Return the kind of messages on a topic, its first part."""
    return topic.partition("/")[0]


def _said(error: Exception) -> str:
    return str(error) or type(error).__name__


def _plausible(opcode: int) -> bool:
    return Opcode.HEADER <= opcode <= Opcode.DATA_END


def _next(end: _End | None, offset: int) -> int | None:
    """Return where the next record after `offset` begins, according to the index."""
    if end is None:
        return None
    place = bisect_right(end.offsets, offset)
    return end.offsets[place] if place < len(end.offsets) else end.summary_start


def _expect_crc(data: bytes, expected: int) -> None:
    found = zlib.crc32(data)
    if found != expected:
        raise ValueError(f"its CRC is {found:08x}, expected {expected:08x}")


def _end_of(stored: Stored) -> _End | None:
    """Return the end of a finished file; None if it is missing or its CRC does not hold."""
    closing = _HEAD.size + _FOOTER_BYTES + len(MAGIC)
    footer_at = stored.size - closing
    if footer_at < len(MAGIC):
        return None
    last = stored.read(footer_at, closing)
    if not last.endswith(MAGIC) or _HEAD.unpack_from(last) != (Opcode.FOOTER, _FOOTER_BYTES):
        return None
    try:
        footer = Footer.read(ReadDataStream(BytesIO(last[_HEAD.size :])))
        start = footer.summary_start or footer_at
        if not len(MAGIC) <= start <= footer_at:
            return None
        summary = stored.read(start, stored.size - start)
        if footer.summary_crc:
            _expect_crc(summary[: -len(MAGIC) - _CRC.size], footer.summary_crc)
        return _summary(summary, start, footer_at)
    except InputError:
        raise
    except Exception:  # noqa: BLE001 - whatever is wrong, there is no usable summary
        return None


def _summary(data: bytes, start: int, footer_at: int) -> _End:
    others: list[int] = []
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
            case Opcode.METADATA_INDEX:
                metadata = MetadataIndex.read(stream)
                others.append(metadata.offset)
                covered += metadata.length
            case Opcode.CHANNEL:
                channel = Channel.read(stream)
                topics[channel.id] = channel.topic
            case Opcode.STATISTICS:
                statistics = Statistics.read(stream)
            case _:
                pass
    blocks = sorted(_indexed(chunks, topics), key=lambda block: block.offset)
    covered += sum(_HEAD.size + block.length for block in blocks)
    covered += sum(_index_length(body) for body in chunks)
    offsets = sorted([block.offset - _HEAD.size for block in blocks] + others)
    return _End(start, offsets, topics, blocks, sorted(others), covered, statistics)


def _records(data: bytes) -> Iterator[tuple[int, bytes]]:
    offset = 0
    while offset < len(data):
        opcode, length = _HEAD.unpack_from(data, offset)
        offset += _HEAD.size
        yield opcode, data[offset : offset + length]
        offset += length


def _indexed(chunks: Iterable[bytes], topics: Mapping[int, str]) -> Iterator[Block]:
    """Yield the chunks of these indices.

    mcap's own reader takes seconds for the channels of a long recording.
    """
    named = {channel: kind_in(topic) for channel, topic in topics.items()}
    sets: _Sets = {}
    for body in chunks:
        first, last, offset, length, size = _CHUNK_INDEX.unpack_from(body)
        used = body[_CHUNK_INDEX.size : _CHUNK_INDEX.size + size]
        kinds = {named.get(channel, "") for channel, _ in _CHANNEL_OFFSET.iter_unpack(used)}
        yield Block(
            offset + _HEAD.size, length - _HEAD.size, first, last, _shared(sets, kinds or {""})
        )


def _index_length(body: bytes) -> int:
    """Return the bytes of the indices of messages that follow a chunk."""
    size = _CHUNK_INDEX.unpack_from(body)[4]
    return int.from_bytes(body[_CHUNK_INDEX.size + size :][:8], "little")
