"""The structure of an MCAP file: its bytes, how records stand in it, and the summary at its end.

Bytes are read when they are needed. A file stays open while anything may read from it, so that a
recording need not fit into memory; the bytes of a pipe, which cannot be read twice, are kept.

A record is a kind, a length and a body, and most bodies contain lengths too. Where these agree, the
next record follows. Where they do not, or the kind is unknown, the bytes that follow are searched
for the next record that a CRC or a checksum confirms.

The summary of a finished file is trusted if its CRC holds. Then it says where every chunk,
attachment and metadata record begins, and how long it is, whatever happened to their heads.
"""

import os
import re
import stat
import struct
import weakref
import zlib
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from hashlib import sha256
from io import BytesIO
from typing import Final, NamedTuple, TypeAlias

import msgspec
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, Channel, Footer, MetadataIndex, Statistics

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import InputFile, readable
from cubepath.protocol.recordings.plain_messages import PutSettings, settings_in

_WINDOW = 1 << 20
"""Bytes read at a time, and kept for reading on from there."""


class StoredBytes:
    """The bytes that a file had when it was opened; InputError if it has fewer later."""

    def __init__(self, file: InputFile) -> None:
        """Take over the file: it is read on its own descriptor, even after it was closed."""
        self.path = file.path
        self._kept: bytes | None = None
        self._descriptor = -1
        self._at, self._window = 0, b""
        with readable(self.path):
            descriptor = _descriptor_of(file)
            if descriptor is None:
                self._kept = file.whole()
                self.size = len(self._kept)
            else:
                weakref.finalize(self, os.close, descriptor)
                self._descriptor = descriptor
                self.size = os.fstat(descriptor).st_size

    def read(self, offset: int, size: int) -> bytes:
        """Return the bytes from an offset on, fewer than `size` only at the end of the file."""
        begin = offset - self._at
        if begin < 0 or begin + size > len(self._window):
            self._window = self._fetch(offset, max(size, _WINDOW))
            self._at, begin = offset, 0
        return self._window[begin : begin + size]

    def crc(self, end: int) -> int:
        """Return the CRC-32 of the bytes before an offset."""
        found = 0
        for offset in range(0, end, _WINDOW):
            found = zlib.crc32(self._fetch(offset, min(_WINDOW, end - offset)), found)
        return found

    def sha256(self) -> str:
        """Return the SHA-256 of all bytes in hexadecimal, as ``sha256sum`` prints it."""
        found = sha256()
        for offset in range(0, self.size, _WINDOW):
            found.update(self._fetch(offset, min(_WINDOW, self.size - offset)))
        return found.hexdigest()

    def _fetch(self, offset: int, size: int) -> bytes:
        size = min(size, self.size - offset)
        if self._kept is not None:
            return self._kept[offset : offset + size]
        found = b""
        with readable(self.path):
            while len(found) < size:
                piece = os.pread(self._descriptor, size - len(found), offset + len(found))
                if not piece:
                    cut = offset + len(found)
                    raise InputError(
                        f"{self.path}: cut to {cut} bytes while it was read, expected {self.size}"
                    )
                found = found + piece if found else piece
        return found


def _descriptor_of(file: InputFile) -> int | None:
    """Return a descriptor of a regular file, None for anything else."""
    stream = file.from_start()
    try:
        number = stream.fileno()
    except OSError:  # what was read from a pipe has none
        return None
    return os.dup(number) if stat.S_ISREG(os.fstat(number).st_mode) else None


MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")
"""The kind of a record, and the length of its body."""
CRC = struct.Struct("<I")
_U32: Final = 4
_U64: Final = 8
_PATTERN = re.compile(
    # A chunk compressed by zstd or lz4, or by nothing; an attachment; metadata of ours.
    rb"\x06(?=.{36}(?:\x04\0\0\0zstd|\x03\0\0\0lz4|\0\0\0\0))"
    rb"|\x09(?=.{24}[\x01-\xff]\0\0\0)"
    rb"|\x0c(?=.{8}[\x08-\x0f]\0\0\0cubepath)",
    re.DOTALL,
)
_SEEN = 48
"""The most bytes that a pattern looks at, and some."""


def plausible(opcode: int) -> bool:
    """Return whether records of a kind may stand in the data section."""
    return Opcode.HEADER <= opcode <= Opcode.DATA_END


def expect_crc(data: bytes, expected: int) -> None:
    """ValueError if the CRC-32 of the data is another."""
    found = zlib.crc32(data)
    if found != expected:
        raise ValueError(f"its CRC is {found:08x}, expected {expected:08x}")


def checksum(values: Mapping[str, str]) -> str:
    """Return the checksum of the values of a metadata record.

    Such a record has no CRC, and the CRC of the data section comes at the end of the file.
    """
    return sha256(msgspec.json.encode(sorted(values.items()))).hexdigest()


def fits(stored: StoredBytes, offset: int) -> bool:
    """Return whether a record begins at an offset: of a kind, with lengths that agree."""
    start = offset + HEAD.size
    if start > stored.size:
        return False
    opcode: int
    length: int
    opcode, length = HEAD.unpack(stored.read(offset, HEAD.size))
    if start + length > stored.size or not plausible(opcode):
        return False
    body = _Body(stored, start, length)
    match opcode:
        case Opcode.HEADER | Opcode.METADATA:
            end = body.after(body.after(0, _U32), _U32)
        case Opcode.CHUNK:
            end = body.after(body.after(28, _U32), _U64)
        case Opcode.MESSAGE_INDEX:
            end = body.after(2, _U32)
        case Opcode.ATTACHMENT:
            end = body.after(body.after(body.after(16, _U32), _U32), _U64) + CRC.size
        case Opcode.DATA_END:
            end = CRC.size
        case _:  # they do not say it twice
            return True
    return end == length


class _Body:
    """The body of a record, in which numbers tell how many bytes follow them."""

    def __init__(self, stored: StoredBytes, start: int, length: int) -> None:
        self._stored, self._start, self._length = stored, start, length

    def after(self, place: int, width: int) -> int:
        """Return where that ends whose length stands at a place; beyond the end if it cannot."""
        if place + width > self._length:
            return self._length + 1
        length = self._stored.read(self._start + place, width)
        return place + width + int.from_bytes(length, "little")


def found_after(stored: StoredBytes, offset: int, holds: Callable[[int], bool]) -> int | None:
    """Return where the next record after an offset begins that `holds`; None if there is none.

    Chunks, attachments and metadata are looked for; `holds` is asked of each place where one could
    begin, and its lengths agree.
    """
    return next((each for each in _places(stored, offset + 1) if holds(each)), None)


def _places(stored: StoredBytes, begin: int) -> Iterator[int]:
    while begin < stored.size:
        # One that begins in this window is seen whole.
        window = stored.read(begin, _WINDOW + _SEEN)
        for found in _PATTERN.finditer(window):
            if found.start() >= _WINDOW:
                break
            if fits(stored, begin + found.start()):
                yield begin + found.start()
        begin += _WINDOW


_CHUNK_INDEX = struct.Struct("<QQQQI")
_CHANNEL_OFFSET = struct.Struct("<HQ")
_FOOTER_BYTES = 20


class ChunkIndex(NamedTuple):
    """A chunk: where its content stands, and the rounds and kinds of its messages.

    The kind of a message is the first part of its topic, "" where the topic is not known yet.
    """

    offset: int
    length: int
    first_round: int
    last_round: int
    kinds: frozenset[str]


@dataclass(frozen=True, slots=True)
class FileSummary:
    """The summary of a finished file, if its CRC holds: where records begin."""

    summary_start: int
    offsets: list[int]
    topics: dict[int, str]
    puts: dict[int, PutSettings]
    blocks: list[ChunkIndex]
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


def end_of(stored: StoredBytes) -> FileSummary | None:
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


def _summary(data: bytes, start: int, footer_at: int) -> FileSummary:
    others: list[int] = []
    heads: dict[int, tuple[int, int]] = {}
    topics: dict[int, str] = {}
    puts: dict[int, PutSettings] = {}
    chunks: list[bytes] = []
    covered = 0
    statistics: Statistics | None = None
    for opcode, body in _records(data[: footer_at - start]):
        stream = ReadDataStream(BytesIO(body))
        match opcode:
            case Opcode.CHUNK_INDEX:
                chunks.append(body)
            case Opcode.ATTACHMENT_INDEX | Opcode.METADATA_INDEX:
                attached = opcode == Opcode.ATTACHMENT_INDEX
                index = (AttachmentIndex if attached else MetadataIndex).read(stream)
                others.append(index.offset)
                covered += index.length
                kind = Opcode.ATTACHMENT if attached else Opcode.METADATA
                heads[index.offset] = kind, index.length - HEAD.size
            case Opcode.CHANNEL:
                channel = Channel.read(stream)
                topics[channel.id] = channel.topic
                note_settings(puts, channel)
            case Opcode.STATISTICS:
                statistics = Statistics.read(stream)
            case _:
                pass
    blocks = sorted(_indexed(chunks, topics), key=lambda block: block.offset)
    covered += sum(HEAD.size + block.length for block in blocks)
    heads |= {each.offset - HEAD.size: (Opcode.CHUNK, each.length) for each in blocks}
    covered += sum(_index_length(body) for body in chunks)
    offsets = sorted([block.offset - HEAD.size for block in blocks] + others)
    return FileSummary(
        start, offsets, topics, puts, blocks, sorted(others), heads, covered, statistics
    )


def note_settings(puts: dict[int, PutSettings], channel: Channel) -> None:
    """Note how the messages of a channel were put, if it states that."""
    found = settings_in(channel.metadata) if channel.metadata else None
    if found is not None:
        puts[channel.id] = found


def _records(data: bytes) -> Iterator[tuple[int, bytes]]:
    offset = 0
    while offset < len(data):
        opcode, length = HEAD.unpack_from(data, offset)
        offset += HEAD.size
        yield opcode, data[offset : offset + length]
        offset += length


def _indexed(chunks: Iterable[bytes], topics: Mapping[int, str]) -> Iterator[ChunkIndex]:
    """Yield the chunks of these indices.

    mcap's own reader takes seconds for the channels of a long recording.
    """
    named = {channel: kind_in(topic) for channel, topic in topics.items()}
    sets: Sets = {}
    for body in chunks:
        first, last, offset, length, size = _CHUNK_INDEX.unpack_from(body)
        used = body[_CHUNK_INDEX.size : _CHUNK_INDEX.size + size]
        kinds = {named.get(channel, "") for channel, _ in _CHANNEL_OFFSET.iter_unpack(used)}
        yield ChunkIndex(
            offset + HEAD.size, length - HEAD.size, first, last, shared(sets, kinds or {""})
        )


def _index_length(body: bytes) -> int:
    """Return the bytes of the indices of messages that follow a chunk."""
    size = _CHUNK_INDEX.unpack_from(body)[4]
    return int.from_bytes(body[_CHUNK_INDEX.size + size :][:8], "little")
