"""Salvaging MCAP files: every record is checked, and damage is reported.

Room: protocol. The readers of the mcap package stop at the first damaged record, or raise whatever
their parsers happen to raise. Here records are split one by one, so only a damaged record itself is
left out: each chunk and attachment has a CRC, and so do the data section and the summary. If a
length is damaged and the records after it cannot be found, the index in the summary tells where to
continue. Messages and attachments are returned only if a CRC covers them.
"""

from __future__ import annotations

import struct
import zlib
from bisect import bisect_right
from collections.abc import Iterable
from dataclasses import dataclass, field
from io import BytesIO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    Footer,
    Message,
    Metadata,
    MetadataIndex,
)
from mcap.stream_reader import breakup_chunk

MAGIC = b"\x89MCAP0\r\n"
_CHUNK_BYTES_MAX = 1 << 30
_HEAD = struct.Struct("<BQ")
_CRC = struct.Struct("<I")
_FOOTER_BYTES = 20


@dataclass(slots=True)
class Salvage:
    """What was found: `problems` is empty if nothing is missing.

    `topics` maps channels to topics; messages keep the order of the file.
    """

    metadata: list[Metadata] = field(default_factory=list)
    attachments: list[Attachment] = field(default_factory=list)
    topics: dict[int, str] = field(default_factory=dict)
    messages: list[Message] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)


def salvage(data: bytes) -> Salvage:
    """Return what can be read of the bytes of an MCAP file; never raises, whatever they are."""
    scan = _Scan(data)
    scan.run()
    return scan.found


@dataclass(frozen=True, slots=True)
class _End:
    """The summary of a finished file, if its CRC holds: where records begin."""

    summary_start: int
    offsets: list[int]
    topics: dict[int, str]


class _Scan:
    """One pass over the bytes."""

    def __init__(self, data: bytes) -> None:
        self.found = Salvage()
        self._data = data
        self._chunks = 0
        self._span = ""
        self._loose: list[Channel | Message] = []
        self._ended = False

    def run(self) -> None:
        data, found = self._data, self.found
        if not data.startswith(MAGIC):
            short = MAGIC.startswith(data)
            what = "truncated within its first bytes" if short else "not an MCAP file"
            found.problems.append(f"{what}: expected it to begin with the magic of MCAP")
            return
        end = _end_of(data)
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
        data = self._data
        if offset + _HEAD.size > len(data):
            return None
        opcode, length = _HEAD.unpack_from(data, offset)
        start = offset + _HEAD.size
        after: int = start + length
        known = _next(end, offset)
        if after > len(data) or (known is not None and after > known) or not _plausible(opcode):
            if known is None:
                return None
            self.found.problems.append(
                f"corrupt at byte {offset}: a record is damaged, reading goes on at byte {known}"
            )
            return known
        body = data[start:after]
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
                self._take_chunk(Chunk.read(stream))
            case Opcode.ATTACHMENT:
                # mcap's own reader does not check this CRC.
                _expect_crc(body[: -_CRC.size], _CRC.unpack(body[-_CRC.size :])[0])
                self.found.attachments.append(Attachment.read(stream))
            case Opcode.METADATA:
                self.found.metadata.append(Metadata.read(stream))
            case Opcode.CHANNEL:
                self._loose.append(Channel.read(stream))
            case Opcode.MESSAGE:
                self._loose.append(Message.read(stream, len(body)))
            case Opcode.DATA_END:
                crc = _CRC.unpack(body)[0]
                self._ended = True
                self._take_end(crc, offset)
            case _:
                pass

    def _take_chunk(self, chunk: Chunk) -> None:
        # Its head has no CRC of its own: this only tells users what may be lost.
        self._span = f" (log times {chunk.message_start_time} to {chunk.message_end_time})"
        if chunk.uncompressed_size > _CHUNK_BYTES_MAX:
            raise ValueError(f"it claims to hold {chunk.uncompressed_size} bytes")
        if not chunk.uncompressed_crc:
            raise ValueError("it has no checksum")
        self._keep(breakup_chunk(chunk, validate_crc=True))

    def _keep(self, records: Iterable[object]) -> None:
        for record in records:
            match record:
                case Channel():
                    self.found.topics[record.id] = record.topic
                case Message():
                    self.found.messages.append(record)
                case _:
                    pass

    def _take_end(self, crc: int, offset: int) -> None:
        found = self.found
        # By the specification, 0 means that there is no CRC.
        holds = not crc or zlib.crc32(self._data[:offset]) == crc
        if not holds and not found.problems:
            found.problems.append("corrupt: the CRC of the data section does not hold")
        if holds and crc:
            self._keep(self._loose)
        elif self._loose:
            found.problems.append(
                f"{len(self._loose)} records stand outside chunks, and nothing vouches for them"
            )

    def _tail(self, offset: int) -> str:
        """Return what is wrong after the data section, once all messages have been read."""
        size = len(self._data)
        closing = self._data.find(MAGIC, offset)
        if closing < 0:
            what = f"truncated at byte {size}: the closing magic is missing"
        elif closing + len(MAGIC) < size:
            what = f"corrupt: {size - closing - len(MAGIC)} bytes follow after the end"
        else:
            what = f"corrupt: the summary from byte {offset} on does not hold"
        return f"{what}; all messages could be read"

    def _stop(self, offset: int) -> str:
        data = self._data
        # A file that ends properly, or continues with something that is no record, was not cut off.
        cut = not data.endswith(MAGIC) and (
            offset + _HEAD.size > len(data) or _plausible(data[offset])
        )
        return (
            f"{'truncated' if cut else 'corrupt'} at byte {offset} of {len(data)}: {self._chunks}"
            f" chunks and {len(self.found.messages)} messages could be read before it"
        )


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


def _end_of(data: bytes) -> _End | None:
    """Return the end of a finished file; None if it is missing or its CRC does not hold."""
    footer_at = len(data) - len(MAGIC) - _FOOTER_BYTES - _HEAD.size
    if footer_at < len(MAGIC) or not data.endswith(MAGIC):
        return None
    if _HEAD.unpack_from(data, footer_at) != (Opcode.FOOTER, _FOOTER_BYTES):
        return None
    try:
        footer = Footer.read(ReadDataStream(BytesIO(data[footer_at + _HEAD.size :])))
        start = footer.summary_start or footer_at
        if footer.summary_crc:
            _expect_crc(data[start : -len(MAGIC) - _CRC.size], footer.summary_crc)
        return _summary(data, start, footer_at)
    except Exception:  # noqa: BLE001 - whatever is wrong, there is no usable summary
        return None


def _summary(data: bytes, start: int, footer_at: int) -> _End:
    offsets: list[int] = []
    topics: dict[int, str] = {}
    offset = start
    while offset < footer_at:
        opcode, length = _HEAD.unpack_from(data, offset)
        offset += _HEAD.size
        stream = ReadDataStream(BytesIO(data[offset : offset + length]))
        offset += length
        match opcode:
            case Opcode.CHUNK_INDEX:
                offsets.append(ChunkIndex.read(stream).chunk_start_offset)
            case Opcode.ATTACHMENT_INDEX:
                offsets.append(AttachmentIndex.read(stream).offset)
            case Opcode.METADATA_INDEX:
                offsets.append(MetadataIndex.read(stream).offset)
            case Opcode.CHANNEL:
                channel = Channel.read(stream)
                topics[channel.id] = channel.topic
            case _:
                pass
    return _End(start, sorted(offsets), topics)
