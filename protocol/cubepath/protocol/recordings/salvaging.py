"""Salvaging MCAP files: every record is checked, and damage is reported.

The readers of the mcap package stop at the first damaged record, or raise whatever their parsers
happen to raise. Here records are split one by one, so only a damaged record itself is left out:
each chunk and attachment has a CRC, and so do the data section and the summary. If a length is
damaged and the records after it cannot be found, the index in the summary tells where to continue;
if that is lost as well, the bytes that follow are searched for a record whose CRC holds. Messages
and attachments are returned only if a CRC covers them.

What is found says where the chunks are, not what is in them: messages are unpacked when they are
asked for, a chunk at a time, so that memory does not grow with the file. If the CRCs of a finished
file hold, `outline` finds the same from its end, without going through the records.
"""

import struct
from collections.abc import Iterable
from dataclasses import dataclass, field
from io import BytesIO
from typing import NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Metadata, Statistics
from mcap.stream_reader import get_chunk_data_stream

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.recordings.mcap_file import (
    CRC,
    HEAD,
    MAGIC,
    ChunkIndex,
    FileSummary,
    Sets,
    StoredBytes,
    checksum,
    end_of,
    expect_crc,
    fits,
    found_after,
    kind_in,
    note_settings,
    plausible,
    shared,
)
from cubepath.protocol.recordings.plain_messages import PutSettings

_CHUNK_BYTES_MAX = 1 << 30
_MESSAGE = struct.Struct("<HIQQ")


class SalvagedMessage(NamedTuple):
    """A message as it stands in a file."""

    channel: int
    sequence: int
    round: int
    wall_ns: int
    data: bytes


@dataclass(slots=True)
class Salvage:
    """What was found: `problems` is empty if nothing is missing.

    `topics` maps channels to topics, and `puts` those of a recording of any keys to how their
    messages were put. Messages are those of `blocks` and then the `loose` ones, in
    the order of the file; `gap` is the first error in the order of writing, if any.
    """

    metadata: list[Metadata] = field(default_factory=list)
    attachments: list[Attachment] = field(default_factory=list)
    topics: dict[int, str] = field(default_factory=dict)
    puts: dict[int, PutSettings] = field(default_factory=dict)
    blocks: list[ChunkIndex] = field(default_factory=list)
    loose: list[SalvagedMessage] = field(default_factory=list)
    messages: int = 0
    gap: str | None = None
    problems: list[str] = field(default_factory=list)


def salvage(stored: StoredBytes) -> Salvage:
    """Return what can be read of an MCAP file; whatever its bytes are, nothing is raised.

    InputError if the file cannot be read, or is cut meanwhile.
    """
    scan = _Scan(stored)
    scan.run()
    return scan.found


def outline(stored: StoredBytes) -> Salvage | None:
    """Return what a finished file says of itself, if all its CRCs hold; else None.

    The CRC of the data section covers every byte before it, so no chunk has to be unpacked. What
    the writer itself got wrong, such as a gap, is not seen.
    """
    end = end_of(stored)
    if end is None or end.statistics is None:
        return None
    try:
        return _outlined(stored, end, end.statistics)
    except Exception:  # noqa: BLE001 - whatever is wrong, `salvage` finds it
        return None


def _outlined(stored: StoredBytes, end: FileSummary, statistics: Statistics) -> Salvage | None:
    data_end = end.summary_start - HEAD.size - CRC.size
    ending = stored.read(data_end, HEAD.size + CRC.size)
    crc = CRC.unpack(ending[HEAD.size :])[0]
    if HEAD.unpack_from(ending) != (Opcode.DATA_END, CRC.size) or not crc:
        return None
    header = HEAD.unpack(stored.read(len(MAGIC), HEAD.size))[1]
    if len(MAGIC) + HEAD.size + header + end.covered != data_end:
        return None  # something stands outside of what the summary tells of
    if stored.crc(data_end) != crc:
        return None
    found = Salvage(
        topics=end.topics, puts=end.puts, blocks=end.blocks, messages=statistics.message_count
    )
    for offset in end.others:
        opcode, length = HEAD.unpack(stored.read(offset, HEAD.size))
        body = stored.read(offset + HEAD.size, length)
        stream = ReadDataStream(BytesIO(body))
        if opcode == Opcode.ATTACHMENT:
            found.attachments.append(_attachment(body))
        elif opcode == Opcode.METADATA:
            found.metadata.append(Metadata.read(stream))
        else:
            return None
    return found


def messages_in(stored: StoredBytes, block: ChunkIndex) -> list[SalvagedMessage]:
    """Return the messages of a block, once more with its CRC; InputError if it does not hold."""
    try:
        body = stored.read(block.offset, block.length)
        _, messages = _unpacked(Chunk.read(ReadDataStream(BytesIO(body))))
    except InputError:
        raise
    except Exception as error:  # noqa: BLE001 - parsers and decompressors raise many kinds
        raise InputError(
            f"{stored.path}: the chunk at byte {block.offset} cannot be read any more:"
            f" {_error_text(error)}"
        ) from None
    return messages


class _Scan:
    """One pass over the bytes."""

    def __init__(self, stored: StoredBytes) -> None:
        self.found = Salvage()
        self._stored = stored
        self._end = end_of(stored)
        self._chunks = 0
        self._span = ""
        self._loose: list[Channel | SalvagedMessage] = []
        self._ended = False
        self._sets: Sets = {}

    def run(self) -> None:
        found, end = self.found, self._end
        if end is not None:
            found.topics.update(end.topics)
            found.puts.update(end.puts)
        offset = self._first()
        if offset is None:
            return
        while not self._ended:
            if end is not None and offset >= end.summary_start:
                found.problems.append(f"corrupt before byte {offset}: no mark ends the data")
                return
            after = self._record(offset)
            if after is None:
                found.problems.append(self._stop(offset))
                return
            offset = after
        if end is None:
            found.problems.append(self._tail(offset))

    def _first(self) -> int | None:
        """Return where the first record begins; None if the file is none, as far as one can see."""
        stored, first = self._stored, len(MAGIC)
        magic = stored.read(0, first)
        if magic == MAGIC:
            return first
        short = MAGIC.startswith(magic)
        what = "truncated within its first bytes" if short else "not an MCAP file"
        self.found.problems.append(f"{what}: expected it to begin with the magic of MCAP")
        if self._end is not None or fits(stored, first):
            return first
        return found_after(stored, 0, self._holds)

    def _record(self, offset: int) -> int | None:
        """Read the record at `offset`; return where the next one begins, None if nowhere."""
        stored, end = self._stored, self._end
        start = offset + HEAD.size
        head = None if end is None else end.heads.get(offset)
        if head is not None:
            if head != HEAD.unpack(stored.read(offset, HEAD.size)):
                self.found.problems.append(
                    f"corrupt at byte {offset}: the head of a record is damaged"
                )
        elif not fits(stored, offset) or self._is_no_end(offset):
            return self._lost(offset)
        else:
            head = HEAD.unpack(stored.read(offset, HEAD.size))
        opcode, length = head
        after = start + length
        if end is not None and after > end.after(offset):
            return self._lost(offset)
        if opcode not in _TAKEN:
            return after
        body = stored.read(start, length)
        try:
            self._take(opcode, body, offset)
        except Exception as error:  # noqa: BLE001 - parsers and decompressors raise many kinds
            self.found.problems.append(f"corrupt at byte {offset}: {self._what(opcode, error)}")
        return after

    def _is_no_end(self, offset: int) -> bool:
        """Return whether a mark that ends the data stands where the data does not end."""
        end, size = self._end, HEAD.size + CRC.size
        is_mark = self._stored.read(offset, 1)[0] == Opcode.DATA_END
        return is_mark and end is not None and offset + size != end.summary_start

    def _lost(self, offset: int) -> int | None:
        """Return where to continue after a record that is damaged; None if nowhere."""
        if self._end is not None:
            found = self._end.after(offset)
        else:
            searched = found_after(self._stored, offset, self._holds)
            if searched is None:
                return None
            found = searched
        self.found.problems.append(
            f"corrupt at byte {offset}: a record is damaged, reading continues at byte {found}"
        )
        return found

    def _holds(self, offset: int) -> bool:
        """Return whether a record that was searched for is one, by its CRC or its checksum."""
        opcode, length = HEAD.unpack(self._stored.read(offset, HEAD.size))
        body = self._stored.read(offset + HEAD.size, length)
        try:
            if opcode == Opcode.CHUNK:
                return bool(_unpacked(Chunk.read(ReadDataStream(BytesIO(body))))[1])
            if opcode == Opcode.ATTACHMENT:
                return bool(_attachment(body).name)
            values = Metadata.read(ReadDataStream(BytesIO(body))).metadata
        except Exception:  # noqa: BLE001 - parsers and decompressors raise many kinds
            return False
        stated = values.pop("checksum", None)
        # That of parameters does not cover the format beside them.
        without = {key: value for key, value in values.items() if key != "format"}
        return stated in (checksum(values), checksum(without))

    def _what(self, opcode: int, error: Exception) -> str:
        if opcode == Opcode.CHUNK:
            return f"chunk {self._chunks}{self._span} cannot be read: {_error_text(error)}"
        return f"a record of kind {opcode} cannot be read: {_error_text(error)}"

    def _take(self, opcode: int, body: bytes, offset: int) -> None:
        stream = ReadDataStream(BytesIO(body))
        match opcode:
            case Opcode.CHUNK:
                self._chunks += 1
                self._span = ""
                self._take_chunk(Chunk.read(stream), offset + HEAD.size, len(body))
            case Opcode.ATTACHMENT:
                self.found.attachments.append(_attachment(body))
            case Opcode.METADATA:
                self.found.metadata.append(Metadata.read(stream))
            case Opcode.CHANNEL:
                self._loose.append(Channel.read(stream))
            case Opcode.MESSAGE:
                self._loose.append(_message(body))
            case _:
                crc = CRC.unpack(body)[0]
                self._ended = True
                self._take_end(crc, offset)

    def _take_chunk(self, chunk: Chunk, offset: int, length: int) -> None:
        # Its head has no CRC: this only tells users what may be lost.
        self._span = f" (log times {chunk.message_start_time} to {chunk.message_end_time})"
        channels, messages = _unpacked(chunk)
        self._name(channels)
        self._count(messages)
        if messages:
            rounds = [message.round for message in messages]
            topics = {self.found.topics.get(message.channel, "") for message in messages}
            kinds = shared(self._sets, map(kind_in, topics))
            self.found.blocks.append(ChunkIndex(offset, length, min(rounds), max(rounds), kinds))

    def _name(self, channels: Iterable[Channel]) -> None:
        for channel in channels:
            self.found.topics[channel.id] = channel.topic
            note_settings(self.found.puts, channel)

    def _count(self, messages: Iterable[SalvagedMessage]) -> None:
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
            found.loose = [each for each in self._loose if isinstance(each, SalvagedMessage)]
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
            follow = "byte follows" if more == 1 else "bytes follow"
            what = f"corrupt: {more} {follow} after the end"
        else:
            what = f"corrupt: the summary from byte {offset} on does not hold"
        lost = self.found.problems or self.found.gap is not None
        return what if lost else f"{what}; all messages could be read"

    def _stop(self, offset: int) -> str:
        stored = self._stored
        # A file that ends properly, or continues with something that is no record, was not cut off.
        cut = stored.read(stored.size - len(MAGIC), len(MAGIC)) != MAGIC and (
            offset + HEAD.size > stored.size or plausible(stored.read(offset, 1)[0])
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


def _unpacked(chunk: Chunk) -> tuple[list[Channel], list[SalvagedMessage]]:
    """Return the channels and messages of a chunk; raises any error if its CRC does not hold."""
    if chunk.uncompressed_size > _CHUNK_BYTES_MAX:
        raise ValueError(f"it claims to hold {chunk.uncompressed_size} bytes")
    if not chunk.uncompressed_crc:
        raise ValueError("it has no checksum")
    stream, size = get_chunk_data_stream(chunk, validate_crc=True)
    data = stream.read(size)
    channels: list[Channel] = []
    messages: list[SalvagedMessage] = []
    offset = 0
    while offset < size:
        opcode, length = HEAD.unpack_from(data, offset)
        start = offset + HEAD.size
        offset = start + length
        if offset > size:
            raise ValueError("a record in it is longer than the chunk")
        if opcode == Opcode.MESSAGE:
            messages.append(_message(data[start:offset]))
        elif opcode == Opcode.CHANNEL:
            channels.append(Channel.read(ReadDataStream(BytesIO(data[start:offset]))))
    return channels, messages


def _message(body: bytes) -> SalvagedMessage:
    channel, sequence, number, wall_ns = _MESSAGE.unpack_from(body)
    return SalvagedMessage(channel, sequence, number, wall_ns, body[_MESSAGE.size :])


def _attachment(body: bytes) -> Attachment:
    # mcap's own reader does not check this CRC.
    expect_crc(body[: -CRC.size], CRC.unpack(body[-CRC.size :])[0])
    found: Attachment = Attachment.read(ReadDataStream(BytesIO(body)))
    return found


def _error_text(error: Exception) -> str:
    return str(error) or type(error).__name__
