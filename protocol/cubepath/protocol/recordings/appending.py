"""Writing MCAP files: messages are gathered in a chunk, and chunks are appended.

The files are byte for byte those of the writer of the mcap package with its data CRC, which makes
some twenty Python objects and calls for each message and takes thrice as long. Whatever else a file
has is written by that package's own records.

Nothing that was written is touched again: a chunk is written when it is closed, with its length and
CRC, and not before. A chunk that grows in the file would take less bytes where there are many small
ones, and was not taken: its head would have to be written again each time, so a kill between two
writes could cost messages that were safe, and other tools lose a chunk that has no end.
"""

import struct
import zlib
from collections.abc import Mapping
from itertools import chain
from typing import IO

import zstandard
from mcap import records
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode

from cubepath.protocol.recordings.mcap_file import MAGIC

_COMPRESSION = b"zstd"
_MESSAGE = struct.Struct("<BQHIQQ")
_MESSAGE_BYTES = _MESSAGE.size - 9
"""The bytes of a message but for its data, as its length counts them."""
_CHUNK = struct.Struct("<BQQQQII4sQ")
_INDEX = struct.Struct("<BQHI")
_CHUNK_INDEX = struct.Struct("<BQQQQQI")
_CHUNK_INDEX_END = struct.Struct("<QI4sQQ")
_FOOTER = struct.Struct("<BQQQ")


class McapAppender:
    """Appends to an MCAP file; the caller says when a chunk is closed, and closes the stream.

    Whatever the stream raises propagates, and then nothing more can be written.
    """

    def __init__(self, stream: IO[bytes], profile: str) -> None:
        """Begin a file at the start of the stream."""
        self._stream = stream
        self._compress = zstandard.ZstdCompressor().compress
        self._offset = self._crc = 0
        self._schemas: list[bytes] = []
        self._channels: list[bytes] = []
        self._counts: dict[int, int] = {}
        self._times: tuple[int, int] | None = None
        self._chunks = 0
        # Packed, as there may be a million: some 200 bytes each.
        self._chunk_indices = bytearray()
        self._attachments: list[records.AttachmentIndex] = []
        self._metadata: list[records.MetadataIndex] = []
        self._parts: list[bytes] = []
        self._size = 0
        self._indices: dict[int, list[int]] = {}
        """Log times and offsets in turn, by channel."""
        self._log_times: list[int] = []
        """The log times of the open chunk, each once where several in turn have the same."""
        self._append(MAGIC + _packed(records.Header(profile, profile)))

    @property
    def size(self) -> int:
        """Return the bytes of the open chunk."""
        return self._size

    @property
    def written(self) -> int:
        """Return the bytes that were written, without those of the open chunk."""
        return self._offset

    def size_with(self, more: int) -> int:
        """Return the most bytes of the file if it ends after one more message of this size."""
        open_chunk = self._size + more + _MESSAGE.size
        entries = sum(map(len, self._indices.values())) // 2 + 1
        known = sum(map(len, self._schemas)) + sum(map(len, self._channels))
        return (
            self._offset
            + open_chunk
            + open_chunk // 128  # what cannot be compressed grows by less
            + 16 * entries
            + (_INDEX.size + 30) * (len(self._channels) + 1)
            + known
            + len(self._chunk_indices)
            + 256 * (len(self._attachments) + len(self._metadata) + 4)
        )

    def add_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Add a schema; return its number."""
        schema = records.Schema(id=len(self._schemas) + 1, name=name, encoding=encoding, data=data)
        return self._gather(_packed(schema), self._schemas)

    def add_channel(
        self, topic: str, encoding: str, schema: int, metadata: Mapping[str, str] | None = None
    ) -> int:
        """Add a channel, of schema 0 if there is none; return its number."""
        channel = records.Channel(
            id=len(self._channels) + 1,
            topic=topic,
            message_encoding=encoding,
            metadata=dict(metadata or {}),
            schema_id=schema,
        )
        return self._gather(_packed(channel), self._channels)

    def _gather(self, record: bytes, known: list[bytes]) -> int:
        known.append(record)
        self._parts.append(record)
        self._size += len(record)
        return len(known)

    def add_message(
        self, channel: int, sequence: int, log_time: int, publish_time: int, data: bytes
    ) -> None:
        """Add a message to the open chunk; struct.error if a number has too many bits."""
        length = _MESSAGE_BYTES + len(data)
        head = _MESSAGE.pack(Opcode.MESSAGE, length, channel, sequence, log_time, publish_time)
        parts = self._parts
        parts.append(head)
        parts.append(data)
        index = self._indices.get(channel)
        if index is None:
            index = self._indices[channel] = []
        size = self._size
        index.append(log_time)
        index.append(size)
        times = self._log_times
        if not times or times[-1] != log_time:
            times.append(log_time)
        self._size = size + 9 + length

    def close_chunk(self) -> None:
        """Write the open chunk, and the stream out; a chunk without messages stays open."""
        if self._indices:
            self._write_chunk()
        self._stream.flush()

    def _write_chunk(self) -> None:
        indices = self._indices
        first, last = min(self._log_times), max(self._log_times)
        content = b"".join(self._parts)
        packed = self._compress(content)
        head = _CHUNK.pack(
            Opcode.CHUNK,
            _CHUNK.size - 9 + len(packed),
            first,
            last,
            len(content),
            zlib.crc32(content),
            len(_COMPRESSION),
            _COMPRESSION,
            len(packed),
        )
        start, length = self._offset, len(head) + len(packed)
        indexes: list[bytes] = []
        offsets: list[int] = []
        at = start + length
        for channel, index in indices.items():
            size = 8 * len(index)
            indexes.append(_INDEX.pack(Opcode.MESSAGE_INDEX, size + 6, channel, size))
            indexes.append(struct.pack(f"<{len(index)}Q", *index))
            offsets += channel, at
            at += _INDEX.size + size
            self._counts[channel] = self._counts.get(channel, 0) + len(index) // 2
        self._parts = []
        self._size = 0
        self._indices = {}
        self._log_times = []
        self._append(b"".join((head, packed, *indexes)))
        known = self._times or (first, last)
        self._times = min(first, known[0]), max(last, known[1])
        self._chunks += 1
        places = struct.pack("<" + "HQ" * len(indices), *offsets)
        size = _CHUNK_INDEX.size + len(places) + _CHUNK_INDEX_END.size - 9
        self._chunk_indices += _CHUNK_INDEX.pack(
            Opcode.CHUNK_INDEX, size, first, last, start, length, len(places)
        )
        self._chunk_indices += places
        self._chunk_indices += _CHUNK_INDEX_END.pack(
            at - start - length, len(_COMPRESSION), _COMPRESSION, len(packed), len(content)
        )

    def add_attachment(self, name: str, media_type: str, data: bytes) -> None:
        """Write an attachment, of no time."""
        record = _packed(
            records.Attachment(
                create_time=0, log_time=0, name=name, media_type=media_type, data=data
            )
        )
        self._attachments.append(
            records.AttachmentIndex(
                offset=self._offset,
                length=len(record),
                create_time=0,
                log_time=0,
                data_size=len(data),
                name=name,
                media_type=media_type,
            )
        )
        self._append(record)

    def add_metadata(self, name: str, metadata: Mapping[str, str]) -> None:
        """Write a metadata record."""
        record = _packed(records.Metadata(name=name, metadata=dict(metadata)))
        self._metadata.append(records.MetadataIndex(self._offset, len(record), name))
        self._append(record)

    def _append(self, data: bytes) -> None:
        self._crc = zlib.crc32(data, self._crc)
        self._offset += len(data)
        self._stream.write(data)

    def finish(self) -> None:
        """Write the open chunk and the summary, by which the file is read from its end."""
        if self._indices:
            self._write_chunk()
        self._append(_packed(records.DataEnd(self._crc)))
        first, last = self._times or (0, 0)
        statistics = records.Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=self._chunks,
            message_count=sum(self._counts.values()),
            metadata_count=len(self._metadata),
            message_start_time=first,
            message_end_time=last,
            schema_count=len(self._schemas),
        )
        groups = [
            (Opcode.SCHEMA, b"".join(self._schemas)),
            (Opcode.CHANNEL, b"".join(self._channels)),
            (Opcode.STATISTICS, _packed(statistics)),
            (Opcode.CHUNK_INDEX, bytes(self._chunk_indices)),
            (Opcode.ATTACHMENT_INDEX, b"".join(map(_packed, self._attachments))),
            (Opcode.METADATA_INDEX, b"".join(map(_packed, self._metadata))),
        ]
        start = at = self._offset
        offsets: list[bytes] = []
        for opcode, group in groups:
            offsets.append(_packed(records.SummaryOffset(opcode, at, len(group))))
            at += len(group)
        summary = b"".join(chain((group for _, group in groups), offsets))
        # The CRC of the summary covers the footer up to its CRC.
        crc = zlib.crc32(_FOOTER.pack(Opcode.FOOTER, 20, start, at), zlib.crc32(summary))
        self._append(summary)
        self._append(_packed(records.Footer(start, at, crc)) + MAGIC)


def _packed(record: records.McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    packed: bytes = builder.end()
    return packed
